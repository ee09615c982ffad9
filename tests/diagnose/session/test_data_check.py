"""Recordings that must be refused, each with its reason."""

from typing import Any

import numpy as np

from edge_service.checks.session import check_data
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, runs

RATIO = 0.02 / (2.0 * np.pi)


def faults(machine: Machine, **changes: Any) -> str:
    frame = frame_of(recorded((), seed=3), **changes)
    return " | ".join(check_data(runs(machine, frame), RATIO).faults)


def test_a_sound_recording_has_no_fault(machine: Machine) -> None:
    assert faults(machine) == ""


def test_a_wrong_unit_is_not_called_friction_as_well(machine: Machine) -> None:
    values = 1000.0 * recorded((), seed=3).columns["torque_command_nm"]
    frame = frame_of(recorded((), seed=3), torque_command_nm=values)
    remarks = check_data(runs(machine, frame), RATIO).remarks
    assert not [each for each in remarks if "friction" in each]


def test_friction_that_a_data_sheet_knows_nothing_of_is_no_wrong_unit(machine: Machine) -> None:
    columns = recorded((), seed=3).columns
    speed = np.gradient(columns["motor_angle_rad"], columns["time_s"])
    rubbed = 3.0 * np.sign(speed) * (np.abs(speed) > 0.5)
    frame = frame_of(recorded((), seed=3), torque_command_nm=columns["torque_command_nm"] + rubbed)
    check = check_data(runs(machine, frame), RATIO)
    assert check.faults == ()
    (remark,) = [each for each in check.remarks if "wrong unit" in each]
    assert "times what the machine file says" in remark


def test_too_little_motion(machine: Machine) -> None:
    columns = recorded((), seed=3).columns
    noise = np.random.default_rng(1).standard_normal((2, len(columns["motor_angle_rad"])))
    still = columns["motor_angle_rad"][0] + 5e-6 * noise[0]
    table = columns["table_position_m"][0] + 5e-8 * noise[1]
    assert "moves for" in faults(machine, motor_angle_rad=still, table_position_m=table)


def test_nothing_at_all() -> None:
    (fault,) = check_data([], RATIO).faults
    assert fault.startswith("no unbroken run of a second or more")
