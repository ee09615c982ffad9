"""A gap is a matter of what is stated to matter; why an effect is not judged."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.diagnose.candidates.regressors import unobservable
from edge_service.diagnose.residual.noise import INTERPOLATION_M, TOLERANCE_OF_FLOOR
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from edge_service.models.machine import Machine

from ..conftest import diagnosed, recorded, session_of


def drag(machine_file: Path, folder: Path, more: str = "") -> dict[str, Any]:
    stated = folder / "machine.toml"
    stated.write_text(machine_file.read_text() + more)
    return diagnosed(stated, folder, str(recorded(("drag_error",), 3).write_csv(folder / "a.csv")))


@pytest.mark.slow
@pytest.mark.smoke
def test_a_gap_within_the_stated_tolerance_is_none(machine_file: Path, tmp_path: Path) -> None:
    found = drag(machine_file, tmp_path, "\n[tolerance]\ntorque_nm = 0.5\nposition_m = 1e-3\n")
    assert found["verdict"] == "no_gap"
    assert found["effects"] == []
    gap = found["gap"]
    assert gap["torque_nm"]["tolerance"] == 0.5
    assert gap["torque_nm"]["before"] < 0.5
    assert gap["torque_nm"]["floor_source"] == "recording"


@pytest.mark.slow
def test_without_one_it_is_a_part_of_the_floor(machine_file: Path, tmp_path: Path) -> None:
    found = drag(machine_file, tmp_path)
    assert [each["name"] for each in found["effects"]] == ["drag_error"]
    torque, position = found["gap"]["torque_nm"], found["gap"]["transmission_m"]
    assert torque["tolerance"] == pytest.approx(TOLERANCE_OF_FLOOR * torque["noise_floor"])
    assert position["tolerance"] == INTERPOLATION_M


@pytest.mark.parametrize("value", ["0.0", "-1.0", '"much"'])
def test_a_tolerance_that_is_none_is_refused_in_a_line(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], value: str
) -> None:
    wrong = tmp_path / "machine.toml"
    wrong.write_text(machine_file.read_text() + f"\n[tolerance]\ntorque_nm = {value}\n")
    assert main(["gap", "--machine", str(wrong), "none.csv"]) == 2
    said = capsys.readouterr().err
    assert "tolerance.torque_nm" in said
    assert said.count("\n") == 1


@pytest.mark.slow
def test_an_inertia_hardly_known_does_not_hide_friction(machine_file: Path, tmp_path: Path) -> None:
    text = machine_file.read_text()
    value = load_machine(machine_file).model.inertia_kg_m2.value
    loose = re.sub(
        "inertia_kg_m2 = .*", f"inertia_kg_m2 = {{ value = {value}, tolerance = 0.3 }}", text
    )
    path = tmp_path / "loose.toml"
    path.write_text(loose)
    found = drag(path, tmp_path)
    assert [each["name"] for each in found["effects"]] == ["drag_error"]
    assert found["effects"][0]["probability"] > 0.9


@pytest.mark.parametrize(
    ("missing", "blamed", "needs_it", "shows_elsewhere"),
    [
        (TORQUE, "no torque recorded", "inertia_error", "backlash"),
        (TABLE_POSITION, "one encoder only", "backlash", "external_force"),
    ],
)
def test_a_motion_that_shows_nothing_is_not_the_fault_of_a_channel(
    machine: Machine, missing: str, blamed: str, needs_it: str, shows_elsewhere: str
) -> None:
    """One way at one speed shows neither play nor a force that comes and goes."""
    time_s = np.arange(6000) * 1e-3
    noise = np.random.default_rng(1).standard_normal((3, len(time_s)))
    way_m = 0.2 + 0.05 * time_s
    channels = {
        ANGLE: way_m / machine.transmission_ratio_m_per_rad + 5e-6 * noise[0],
        TORQUE: 0.4 + 0.01 * noise[1],
        TABLE_POSITION: way_m + 5e-8 * noise[2],
    }
    del channels[missing]
    reasons = unobservable(session_of(machine, SampleFrame(time_s, channels)))
    assert reasons[needs_it].startswith(blamed)
    assert reasons[shows_elsewhere] == "not visible in this motion"
