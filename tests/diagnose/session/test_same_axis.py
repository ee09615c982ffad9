"""Recordings of different axes are not one session; those of one axis are, whatever ails it."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from edge_service.checks.session import DataCheck, check_data
from edge_service.diagnose.session.recordings import runs_of
from edge_service.diagnose.session.session import rigid_baseline
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine

from ...foreign_plant import DIAGNOSIS, case, simulate
from ..conftest import frame_of, recorded

AILING = (("warmup", 2.0), ("thermal_growth", 2.0), ("backlash", 2.0), ("timestamp_skew", 2.0))


@cache
def piece(number: int, effects: tuple[tuple[str, float], ...], **machine_changes: Any) -> Any:
    """Fifteen seconds of production; the axis has run for five minutes more with each number."""
    return simulate(
        case(
            effects,
            "production",
            seed=100 + number,
            axis_seed=7,
            duration_s=15.0,
            elapsed_s=300.0 * number,
            machine=replace(DIAGNOSIS, **machine_changes),
        )
    )


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
