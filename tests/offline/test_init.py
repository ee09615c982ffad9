"""`init` writes a configuration that is right, or nothing; it never asks where nobody answers."""

import errno
import json
import os
import pty
import re
import select
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import load_config, load_machine
from tests.drivers.bench import free_port

SHEET = ("--lead", "20", "--set", "inertia_kg_m2=1.5e-3")


@pytest.mark.parametrize(
    ("address", "driver"),
    [
        ("modbus://127.0.0.1:{port}", "modbus"),
        ("opc.tcp://127.0.0.1:{port}", "opcua"),
        ("mqtt://127.0.0.1:{port}/a/b", "mqtt"),
    ],
)
def test_what_is_written_is_right(
    address: str, driver: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The device may be off; the configuration is read again as it will be."""
    out = tmp_path / "shop" / "edge.toml"
    line = ["init", address.format(port=free_port()), *SHEET, "--out", str(out), "--axis", "Z"]
    assert main(line) == 0
    config = load_config(out)
    assert [(axis.name, axis.driver) for axis in config.axes] == [("Z", driver)]
    assert load_machine(config.axes[0].machine).axis.lead_m == pytest.approx(0.02)
    assert config.store.folder == out.parent / "history"
    assert sorted(each.name for each in out.parent.iterdir()) == ["edge.toml", "machine.toml"]
    said = capsys.readouterr().out
    assert "not reachable now" in said
    assert f"edge-service doctor {out}" in said
    assert main(["check-config", str(out)]) == 0


@pytest.mark.parametrize("sheet", [SHEET, ()])
def test_a_device_that_says_nothing_is_not_called_right(
    sheet: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = f"modbus://127.0.0.1:{free_port()}"
    assert main(["init", source, *sheet, "--out", str(tmp_path / "edge.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["is_right"] is False


def test_a_recording_is_adopted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace, out = tmp_path / "trace.csv", tmp_path / "edge.toml"
    simulate = ["simulate", "--motion", "friction", "--out", str(trace)]
    assert main(simulate) == 0
    assert main(["init", str(trace), "--lead", "20", "--out", str(out)]) == 0
    axis = load_config(out).axes[0]
    assert (axis.driver, axis.settings["path"]) == ("replay", str(trace))
    assert "understood:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["profibus://127.0.0.1:9", *SHEET], "expected a recording, or modbus://"),
        (["modbus://127.0.0.1:99999", *SHEET], "expected a recording, or modbus://"),
        (["modbus://", *SHEET], "expected a recording, or modbus://"),
        (["127.0.0.1", *SHEET], "expected a recording, or modbus://"),
        ([*SHEET], "SOURCE: expected a recording, or modbus://"),
        (["modbus://127.0.0.1:9", *SHEET, "--axis", "a/b"], "axes.a/b.name"),
        (["modbus://127.0.0.1:9", "--machine", "nowhere.toml"], "nowhere.toml: no such file"),
        (["modbus://127.0.0.1:9", *SHEET, "--set", "table_mass_kg=-3"], "must be greater than 0"),
    ],
)
def test_a_mistake_writes_nothing(
    more: list[str], expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", *more, "--out", str(tmp_path / "edge.toml")]) == 2
    complaint = capsys.readouterr().err.strip()
    assert expected in complaint
    assert "\n" not in complaint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["edge.toml", "machine.toml"])
def test_nothing_is_overwritten_unasked(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_text("mine")
    line = ["init", f"modbus://127.0.0.1:{free_port()}", *SHEET]
    line += ["--out", str(tmp_path / "edge.toml")]
    assert main(line) == 2
    assert f"{name}: is there already; --force overwrites it" in capsys.readouterr().err
    assert [each.read_text() for each in tmp_path.iterdir()] == ["mine"]
    assert main([*line, "--force"]) == 0
    assert "mine" not in (tmp_path / name).read_text()


def test_a_device_that_does_not_fit_yet_is_written_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A topic that no broker takes is refused by the driver's own rules."""
    out = tmp_path / "edge.toml"
    line = ["init", f"mqtt://127.0.0.1:{free_port()}/a+b", *SHEET, "--out", str(out)]
    assert main(line) == 1
    said = capsys.readouterr().out
    assert re.search(r"not right yet: \S*edge.toml: axes.X.settings.topic", said)
    assert f"edge-service check-config {out}" in said
    assert out.is_file()


def test_what_is_not_known_is_left_out_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody is at a terminal."""
    out = tmp_path / "edge.toml"
    line = ["init", "modbus://127.0.0.1:9", "--screw", "20x10 C18200 P900", "--out", str(out)]
    assert main(line) == 0
    assert "machine.toml: model.inertia_kg_m2: missing" in capsys.readouterr().out
    written = (tmp_path / "machine.toml").read_text()
    assert "lead_m = 0.01" in written
    assert "dynamic_load_rating_n = 18200.0" in written


ASKED = ("Travel per revolution", "Inertia", "Dynamic load rating", "Preload of", "Drag torque")
PATIENCE_S = 60.0
SETSID = shutil.which("setsid")


class Terminal:
    """A terminal at which `init` runs, and a person who reads before typing."""

    def __init__(self, folder: Path) -> None:
        self._own, theirs = pty.openpty()
        line = ["init", f"modbus://127.0.0.1:{free_port()}"]
        command = [str(SETSID), "--ctty", "--wait", sys.executable, "-m", "edge_service", *line]
        places = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
        self._process = subprocess.Popen(
            command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=folder, env=places
        )
        os.close(theirs)
        self.said = ""
        self._read = 0

    def answer(self, question: str, typed: str) -> None:
        while question not in self.said[self._read :]:
            assert self._hear(), self.said
        self._read = len(self.said)
        os.write(self._own, typed.encode())

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


@pytest.mark.skipif(SETSID is None, reason="setsid is not installed")
def test_wrong_answers_are_asked_again(tmp_path: Path) -> None:
    """Numbers of no use are told at once, not when all has been answered."""
    terminal = Terminal(tmp_path)
    for wrong in ("ten", "10 mm", "nan", "1e999", "0", "-10", "\xff"):
        terminal.answer(ASKED[0], f"{wrong}\n")
    terminal.answer(ASKED[0], "10,5\n")
    terminal.answer(ASKED[1], "1.5e-3\n")
    for question in ASKED[2:]:
        terminal.answer(question, "\n")
    assert (terminal.end(), terminal.said.count("expected a number above 0")) == (0, 7)
    machine = load_machine(load_config(tmp_path / "edge.toml").axes[0].machine)
    assert machine.axis.lead_m == pytest.approx(0.0105)
    assert machine.axis.dynamic_load_rating_n is None


@pytest.mark.skipif(SETSID is None, reason="setsid is not installed")
def test_whoever_goes_away_leaves_nothing(tmp_path: Path) -> None:
    terminal = Terminal(tmp_path)
    terminal.answer(ASKED[0], "1\n")
    terminal.answer(ASKED[1], "\x04")
    assert terminal.end() == 130
    assert "Traceback" not in terminal.said
    assert not list(tmp_path.iterdir())
