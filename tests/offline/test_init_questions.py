"""`edge-service init` at a terminal: answers, wrong answers, and whoever goes away."""

import errno
import os
import pty
import select
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from edge_service.config import load_config, load_machine
from tests.drivers.bench import free_port

PATIENCE_S, QUIET_S = 60.0, 5.0
INTERRUPT, END = "\x03", "\x04"
ASKED = ("Travel per revolution", "Inertia", "Dynamic load rating", "Preload of", "Drag torque")
SETSID = shutil.which("setsid")
pytestmark = pytest.mark.skipif(SETSID is None, reason="setsid is not installed")


class Terminal:
    """A terminal at which the command runs, and a person who reads before typing."""

    def __init__(self, line: Sequence[str], folder: Path) -> None:
        self._own, theirs = pty.openpty()
        command = [str(SETSID), "--ctty", "--wait", sys.executable, "-m", "edge_service", *line]
        self._process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=folder, env=_environment()
        )
        os.close(theirs)
        self.said = ""
        self._read = 0

    def answer(self, question: str, typed: str) -> None:
        """Wait for a question, then type."""
        while question not in self.said[self._read :]:
            assert self._hear(), self.said
        self._read = len(self.said)
        os.write(self._own, typed.encode())

    def leave(self, question: str, key: str) -> None:
        """Wait for a question, then press a key, again if it came before anybody read."""
        self.answer(question, key)
        while True:
            if not select.select([self._own], [], [], QUIET_S)[0]:
                os.write(self._own, key.encode())
            elif not self._hear():
                return

    def end(self) -> int:
        """Exit status, once all was read."""
        while self._hear():
            pass
        os.close(self._own)
        return self._process.wait(PATIENCE_S)

    def _hear(self) -> bool:
        ready, _, _ = select.select([self._own], [], [], PATIENCE_S)
        assert ready, self.said
        try:
            heard = os.read(self._own, 4096)
        except OSError as error:  # nobody holds the other end any more
            assert error.errno == errno.EIO
            return False
        self.said += heard.decode(errors="replace")
        return bool(heard)


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}


def begun(folder: Path) -> Terminal:
    return Terminal(["init", f"modbus://127.0.0.1:{free_port()}"], folder)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_wrong_answers_are_asked_again(tmp_path: Path) -> None:
    """Numbers of no use are told at once, not when all has been answered."""
    terminal = begun(tmp_path)
    for wrong in ("ten", "10 mm", "nan", "inf", "1e999", "0", "-10", "\xff"):
        terminal.answer(ASKED[0], f"{wrong}\n")
    terminal.answer(ASKED[0], "10,5\n")
    terminal.answer(ASKED[1], "1.5e-3\n")
    for question in ASKED[2:]:
        terminal.answer(question, "\n")
    assert terminal.end() == 0
    assert terminal.said.count("expected a number above 0") == 8
    config = load_config(tmp_path / "edge.toml")
    machine = load_machine(config.axes[0].machine)
    assert machine.axis.lead_m == pytest.approx(0.0105)
    assert machine.axis.dynamic_load_rating_n is None
    assert names(tmp_path) == ["edge.toml", "machine.toml"]


@pytest.mark.parametrize("key", [INTERRUPT, END])
@pytest.mark.parametrize("before", [0, pytest.param(4, marks=pytest.mark.slow)])
def test_whoever_goes_away_leaves_nothing(before: int, key: str, tmp_path: Path) -> None:
    (tmp_path / "edge.toml").write_text("mine")
    terminal = begun(tmp_path)
    for question in ASKED[:before]:
        terminal.answer(question, "1\n")
    terminal.leave(ASKED[before], key)
    assert terminal.end() == 130
    assert "Traceback" not in terminal.said
    assert names(tmp_path) == ["edge.toml"]
    assert (tmp_path / "edge.toml").read_text() == "mine"


@pytest.mark.slow
def test_too_little_is_told_and_nothing_is_written(tmp_path: Path) -> None:
    terminal = begun(tmp_path)
    for question in ASKED:
        terminal.answer(question, "\n")
    assert terminal.end() == 2
    assert "edge-service: --machine: missing" in terminal.said
    assert names(tmp_path) == []
