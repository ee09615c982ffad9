"""A reading at the drive's limit says how large the torque was at least, and no more."""

from pathlib import Path

import numpy as np
import pytest

from edge_service.config import load_machine
from edge_service.messages.samples import Floats

from ..bench.real_machines import written
from .conftest import diagnosed, frame_of, recorded, runs, torque_gap

LIMIT = 0.6
"""Of the greatest torque."""


def clipped(torque_nm: Floats) -> tuple[float, Floats]:
    limit_nm = round(LIMIT * float(np.abs(torque_nm).max()), 3)
    return limit_nm, np.clip(torque_nm, -limit_nm, limit_nm)


@pytest.fixture
def limited(machine_file: Path, tmp_path: Path) -> tuple[Path, str]:
    """A machine file that states the limit, and a healthy recording that stays at it."""
    columns = dict(recorded((), seed=3).columns)
    limit_nm, columns["torque_command_nm"] = clipped(columns["torque_command_nm"])
    return stated(machine_file, tmp_path, limit_nm), written(tmp_path / "a.csv", columns)


def stated(machine_file: Path, folder: Path, limit_nm: float) -> Path:
    text, path = machine_file.read_text(), folder / "machine.toml"
    assert "max_torque_nm" not in text
    path.write_text(text.replace("[axis]", f"[axis]\nmax_torque_nm = {limit_nm:.4f}", 1))
    return path


@pytest.mark.slow
def test_a_healthy_axis_at_the_limit_has_no_gap(
    limited: tuple[Path, str], machine_file: Path, tmp_path: Path
) -> None:
    machine, trace = limited
    found = diagnosed(machine, tmp_path, trace)
    assert found["verdict"] == "no_gap"
    assert any("than the drive's torque limit" in line for line in found["remarks"])
    # where nobody says that it is a limit, the same reading is a gap
    unstated = diagnosed(machine_file, tmp_path, trace)
    assert unstated["gap"]["torque_nm"]["before"] > 2.0 * found["gap"]["torque_nm"]["before"]
    assert unstated["verdict"] != "no_gap"
    assert not any("limit" in line for line in unstated["remarks"])


def test_a_drive_that_gives_less_than_read_is_compared(machine_file: Path, tmp_path: Path) -> None:
    recording = recorded(("saturation",), seed=3)
    greatest_nm = float(np.abs(recording.columns["torque_command_nm"]).max())
    machine = load_machine(stated(machine_file, tmp_path, greatest_nm))
    (run,) = runs(machine, frame_of(recording))
    assert not run.clipped.any()


def test_gap_leaves_out_the_same_rows(
    limited: tuple[Path, str], machine_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    machine, trace = limited
    assert torque_gap(machine, trace, capsys) < torque_gap(machine_file, trace, capsys) / 2.0
