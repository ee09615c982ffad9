"""The demo says what it runs, where and for how long; set-up installs nothing twice."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.documents import ROOT
from tests.programs import ran

LOCKS = tuple(f"deploy/requirements{name}.lock" for name in ("", "-dev", "-package"))
SCRIPTS = ("deploy/demo.sh", "deploy/setup.sh")
COMMAND = """#!/bin/sh
if [ "$1" = --version ]; then echo "edge-service, version 7.8.9"; else echo "$@"; fi
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """Checkout that is set up for running, with a command that repeats what it is asked for."""
    for file in ("pyproject.toml", *LOCKS, *SCRIPTS):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / file, tmp_path / file)
    command = tmp_path / ".venv" / "bin" / "edge-service"
    command.parent.mkdir(parents=True)
    command.write_text(COMMAND)
    command.chmod(0o755)
    mark(tmp_path, "run")
    return tmp_path


def mark(checkout: Path, purpose: str) -> None:
    """State that the checkout is set up for a purpose, as `setup.sh` does."""
    locked = f"cat {' '.join(LOCKS)} pyproject.toml | cksum"
    said = f'echo "{purpose} $({locked})" >.venv/.installed'
    subprocess.run(["sh", "-c", said], cwd=checkout, check=True)


def run(checkout: Path, *line: str) -> "subprocess.CompletedProcess[str]":
    return ran("sh", *line, folder=checkout, variables={"PATH": "/nowhere:/usr/bin:/bin"})


@pytest.mark.parametrize(
    ("arguments", "port"), [((), 8080), (("--port", "9001"), 9001), (("--port=9002",), 9002)]
)
def test_the_banner_tells_version_address_course_and_end(
    checkout: Path, arguments: tuple[str, ...], port: int
) -> None:
    done = run(checkout, "deploy/demo.sh", *arguments)
    assert done.returncode == 0, done.stderr
    for said in ("7.8.9", f"http://127.0.0.1:{port}/", "FAULT", "Ctrl-C"):
        assert said in done.stderr
    assert done.stdout.split() == ["run", "deploy/edge.toml", *arguments]


@pytest.mark.parametrize(("there", "asked"), [("run", "run"), ("dev", "run"), ("dev", "dev")])
def test_what_is_there_is_not_installed_again(checkout: Path, there: str, asked: str) -> None:
    mark(checkout, there)
    done = run(checkout, "deploy/setup.sh", asked)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(("there", "asked"), [("run", "dev"), ("run 1", "run")])
def test_what_is_missing_is_installed(checkout: Path, there: str, asked: str) -> None:
    """A Python without venv and pip stands in, so that nothing is fetched."""
    mark(checkout, there)
    python = checkout / "python3"
    python.write_text('#!/bin/sh\ncase "$1" in -c | --version) exit 0 ;; *) exit 1 ;; esac\n')
    python.chmod(0o755)
    for name in ("python3.11", "python3.12", "python3.13"):
        shutil.copy(python, checkout / name)
    done = run(checkout, "-c", f'PATH="{checkout}:$PATH" sh deploy/setup.sh {asked}')
    assert done.returncode == 2
    assert "[1/3]" in done.stderr
    assert "has neither venv nor pip" in done.stderr
