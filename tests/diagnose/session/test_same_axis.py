"""Recordings of one axis are one session, whatever ails it; others are refused, with the reason."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from edge_service.checks.session import DataCheck, check_data
from edge_service.diagnose.session.recordings import runs_of
from edge_service.diagnose.session.session import rigid_baseline
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine

from ...foreign_plant import DIAGNOSIS
from ..conftest import frame_of, recorded, runs

AILING = ("warmup", "thermal_growth", "backlash", "timestamp_skew")
RATIO = 0.02 / (2.0 * np.pi)


def piece(number: int, causes: tuple[str, ...], **machine_changes: Any) -> Any:
    """Fifteen seconds of production; the axis has run for five minutes more with each number."""
    changed = replace(DIAGNOSIS, **machine_changes)
    begun = {"axis_seed": 7, "duration_s": 15.0, "elapsed_s": 300.0 * number}
    return recorded(causes, 100 + number, 2.0, machine=changed, **begun)


def checked(machine: Machine, *frames: SampleFrame) -> DataCheck:
    baseline = rigid_baseline(machine)
    names = [f"{letter}.csv" for letter in "abc"]
    return check_data(runs_of(frames, baseline), baseline.ratio_m_per_rad, names)


@pytest.mark.parametrize("lacking", [None, "table_position_m", "motor_angle_rad"])
def test_one_axis_that_warms_up_grows_and_has_play_is_one_axis(
    machine: Machine, lacking: str | None
) -> None:
    less = {lacking: None} if lacking else {}
    frames = [frame_of(piece(k, AILING), **less) for k in range(3)]
    assert checked(machine, *frames).faults == ()


@pytest.mark.parametrize(
    ("changes", "lacking", "says"),
    [
        ({"lead_m": 0.01}, None, "lead 20 mm against 10 mm"),
        ({"lead_m": 0.01}, "table_position_m", "lead 20 mm against 10 mm"),
        ({"inertia_kg_m2": 3.3e-3}, None, "kg m2 against 0.003"),
        (
            {"preload_drag_nm": 2.0, "bearing_drag_nm": 1.0, "guide_force_n": 1200.0},
            "table_position_m",
            "dry friction",
        ),
    ],
)
def test_another_axis_is_named_by_what_makes_it_another(
    machine: Machine, changes: dict[str, float], lacking: str | None, says: str
) -> None:
    less = {lacking: None} if lacking else {}
    one, other = piece(0, ()), piece(1, (), **changes)
    for order in ((one, other), (other, one)):
        (fault,) = checked(machine, *(frame_of(each, **less) for each in order)).faults
        assert fault.startswith("a.csv and b.csv are not from the same axis: ")
    (fault,) = checked(machine, *(frame_of(each, **less) for each in (one, other))).faults
    assert says in fault


def test_the_zero_of_the_table_encoder_belongs_to_the_axis(machine: Machine) -> None:
    one, other = piece(0, ()), piece(1, ())
    moved = frame_of(other, table_position_m=other.columns["table_position_m"] + 1.3e-3)
    (fault,) = checked(machine, frame_of(one), moved).faults
    assert "their table positions are 1.3 mm apart" in fault


def test_the_zero_is_compared_where_the_lead_is_unknown(machine: Machine) -> None:
    """Eight samples of each move: what bends so sharply passes for noise."""
    time_s = np.arange(250) * 0.04
    way_m = 0.3 + 0.06 * np.cos(2.0 * np.pi * 3.0 * time_s + 0.3)
    angle = way_m / (0.02 / (2.0 * np.pi))
    one, other = (
        SampleFrame(time_s, {"motor_angle_rad": angle, "table_position_m": way_m + zero_m})
        for zero_m in (0.0, 1.3e-3)
    )
    assert checked(machine, one, one).faults == ()
    (fault,) = checked(machine, one, other).faults
    assert "their table positions are 1.3 mm apart" in fault


def thinned(frame: SampleFrame, every: int) -> SampleFrame:
    return SampleFrame(frame.time_s[::every], {n: v[::every] for n, v in frame.channels.items()})


@pytest.mark.parametrize("every", [10, 40])
def test_slow_samples_tell_friction_and_no_inertia(machine: Machine, every: int) -> None:
    one, heavy = frame_of(piece(0, ())), frame_of(piece(1, (), inertia_kg_m2=4.5e-3))
    slow = thinned(one, every)
    assert checked(machine, slow, thinned(heavy, every)).faults == ()
    assert checked(machine, slow, thinned(frame_of(piece(1, AILING)), every)).faults == ()
    stiff = piece(1, (), preload_drag_nm=1.2, bearing_drag_nm=0.6, guide_force_n=360.0)
    (fault,) = checked(machine, slow, thinned(frame_of(stiff), every)).faults
    assert "dry friction" in fault


def test_a_torque_at_the_limit_of_the_drive_tells_no_inertia(machine: Machine) -> None:
    """Cut off, the torque makes one inertia look four times another that is two thirds of it."""
    one, other, limit_nm = piece(0, (), inertia_kg_m2=2.2e-3), piece(1, ()), 0.6
    cut = frame_of(
        other, torque_command_nm=np.clip(other.columns["torque_command_nm"], -limit_nm, limit_nm)
    )
    limited = machine.axis.model_copy(update={"max_torque_nm": limit_nm})
    stated = machine.model_copy(update={"axis": limited})
    assert checked(stated, frame_of(one), cut).faults == ()
    (fault,) = checked(machine, frame_of(one), cut).faults
    assert "inertia" in fault


def test_steps_within_the_play_say_nothing_of_the_lead(machine: Machine) -> None:
    """Moves of 20 um in a play of as much: table and motor part, and no unit is wrong for it."""
    time_s = np.arange(20_000) * 1e-3
    angle = 20e-6 / (0.02 / (2.0 * np.pi)) * np.sin(2.0 * np.pi * time_s)
    torque = 0.3 * np.sign(np.cos(2.0 * np.pi * time_s))
    noise = np.random.default_rng(1).standard_normal((2, len(time_s)))
    still = SampleFrame(
        time_s,
        {
            "motor_angle_rad": angle + 1e-6 * noise[0],
            "torque_command_nm": torque + 1e-3 * noise[1],
            "table_position_m": 1e-8 * noise[1],
        },
    )
    whole = frame_of(recorded((), 3))
    assert not any("moves" in each for each in checked(machine, whole, still).faults)


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
