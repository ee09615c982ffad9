"""Recordings with clocks of their own become one session; long ones stay bounded."""

import numpy as np
import pytest

from edge_service.checks.session import check_data
from edge_service.diagnose.session.recordings import LONGEST_S, PAUSE_S, runs_of
from edge_service.diagnose.session.session import TORQUE_GAP, Session, rigid_baseline
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine

PERIOD_S = 4e-3
RATIO = 0.02 / (2.0 * np.pi)


def frame(start_s: float, duration_s: float, temperature_c: float) -> SampleFrame:
    time_s = start_s + PERIOD_S * np.arange(round(duration_s / PERIOD_S))
    angle = 20.0 * np.sin(0.5 * (time_s - start_s) + temperature_c)
    random = np.random.default_rng(int(10 * temperature_c))
    return SampleFrame(
        time_s,
        {
            "motor_angle_rad": angle,
            "torque_command_nm": 0.3 * np.sign(np.gradient(angle))
            + 0.01 * random.standard_normal(len(time_s)),
            "table_position_m": angle * RATIO,
            "temperature_c": np.full(len(time_s), temperature_c),
        },
    )


def test_clocks_that_overlap_follow_one_another_in_any_order(machine: Machine) -> None:
    baseline = rigid_baseline(machine)
    files = [frame(0.0, 20.0, 25.0), frame(0.0, 30.0, 21.0), frame(0.0, 10.0, 23.0)]
    first, second = (
        Session.of_runs(runs_of(order, baseline), baseline) for order in (files, files[::-1])
    )
    starts = [float(run.motion.time_s[0]) for run in first.runs]
    ends = [float(run.motion.time_s[-1]) for run in first.runs]
    assert [float(run.temperature_c[0]) for run in first.runs if run.temperature_c is not None] == [
        21.0,
        23.0,
        25.0,
    ]
    assert np.array(starts[1:]) - np.array(ends[:-1]) == pytest.approx(PAUSE_S)
    assert np.array_equal(first.channels[TORQUE_GAP].gap, second.channels[TORQUE_GAP].gap)
    assert np.array_equal(
        first.channels[TORQUE_GAP].variables["time_s"],
        second.channels[TORQUE_GAP].variables["time_s"],
    )


def test_clocks_that_do_not_overlap_are_kept(machine: Machine) -> None:
    files = [frame(500.0, 20.0, 21.0), frame(0.0, 20.0, 25.0)]
    starts = [float(run.motion.time_s[0]) for run in runs_of(files, rigid_baseline(machine))]
    assert starts == pytest.approx([0.1, 500.1], abs=2 * PERIOD_S)


def test_a_long_session_is_thinned_evenly(machine: Machine) -> None:
    whole_s = 5.0 * LONGEST_S
    runs = runs_of([frame(0.0, whole_s, 21.0)], rigid_baseline(machine))
    spans = [(float(r.motion.time_s[0]), float(r.motion.time_s[-1])) for r in runs]
    assert sum(high - low for low, high in spans) <= LONGEST_S
    assert sum(high - low for low, high in spans) > LONGEST_S / 4.0
    assert spans[0][0] < 1.0
    assert spans[-1][1] > 0.8 * whole_s
    gaps = np.diff([low for low, _ in spans])
    assert gaps.max() < 2.1 * gaps.min()
    held_s = sum(high - low for low, high in spans)
    (said,) = (each for each in check_data(runs, RATIO).remarks if "are evaluated" in each)
    assert said.startswith(f"{held_s / 60.0:.0f} of ")
