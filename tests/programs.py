"""Programs that tests start, and what they say."""

import os
import signal
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any


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


def printed(*line: str | Path, **settings: Any) -> str:
    """Standard output of a program that must succeed, `ran` with these settings."""
    done = ran(*line, **settings)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@contextmanager
def serving(
    *line: str | Path, folder: Path, end: int = signal.SIGTERM, **more: str
) -> Iterator[IO[str]]:
    """Standard output of a program that works until it is told to end, and then ends cleanly."""
    pipes, environment = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}, os.environ | more
    with subprocess.Popen(line, cwd=folder, env=environment, text=True, **pipes) as program:
        assert program.stdout is not None
        try:
            yield program.stdout
        finally:
            program.send_signal(end)
            _, errors = program.communicate(timeout=60.0)
    assert program.returncode == 0
    assert "Traceback" not in errors
