"""Programs that tests start, and what they say."""

import os
import subprocess
from collections.abc import Mapping
from pathlib import Path


def ran(
    *line: str | Path,
    folder: Path | None = None,
    variables: Mapping[str, str] = os.environ,
    **more: str,
) -> "subprocess.CompletedProcess[str]":
    """A program after its end, ten minutes at most; the caller looks at its status."""
    return subprocess.run(
        line,
        cwd=folder,
        env={**variables, **more},
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )


def printed(*line: str | Path, folder: Path | None = None, **more: str) -> str:
    """Standard output of a program that must succeed."""
    done = ran(*line, folder=folder, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
