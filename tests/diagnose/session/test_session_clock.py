"""Recordings with clocks of their own, and at several temperatures, become one session."""

from pathlib import Path

import numpy as np
import pytest

from edge_service.checks.session import check_data
from edge_service.diagnose.session.recordings import LONGEST_S, PAUSE_S, runs_of
from edge_service.diagnose.session.session import TORQUE_GAP, Session, rigid_baseline
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.machine import Machine

from ...bench.real_machines import written
from ..conftest import diagnosed, recorded, torque_gap

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
    warmth_c = [run.temperature_c[0] for run in first.runs if run.temperature_c is not None]
    assert warmth_c == [21.0, 23.0, 25.0]
    assert np.array(starts[1:]) - np.array(ends[:-1]) == pytest.approx(PAUSE_S)
    one, other = (each.channels[TORQUE_GAP] for each in (first, second))
    assert np.array_equal(one.gap, other.gap)
    assert np.array_equal(one.variables["time_s"], other.variables["time_s"])


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
    (said,) = (each for each in check_data(runs, RATIO).remarks if "evaluated" in each)
    assert said.startswith(f"evaluated: {held_s:.0f} of {spans[-1][1] - spans[0][0]:.0f} s, in")


COLD_C, SPAN_K = 21.0, 10.0
DRY_NM, VISCOUS_NM_S_PER_RAD = 0.25, 1.5e-3
"""Of the axis' friction so much depends on its temperature."""
RECORDED_C = (26.0, 22.0, 30.0)
LATER_C = 27.5


def trace(folder: Path, seed: int, temperature_c: float) -> str:
    columns = dict(recorded((), seed=seed).columns)
    time_s: Floats = columns["time_s"]
    random = np.random.default_rng(seed)
    warmth_c = temperature_c + 0.5 * (1.0 - np.exp(-time_s / 60.0))
    thinner = 1.0 / (1.0 + (warmth_c - COLD_C) / SPAN_K) - 1.0
    speed = np.gradient(columns["motor_angle_rad"], time_s)
    moving = np.abs(speed) > 0.5
    rubbed = DRY_NM * np.sign(speed) * moving + VISCOUS_NM_S_PER_RAD * speed
    columns["torque_command_nm"] = columns["torque_command_nm"] + thinner * rubbed
    columns["temperature_c"] = warmth_c + 0.05 * random.standard_normal(len(time_s))
    return written(folder / f"at_{temperature_c:g}.csv", columns)


@pytest.mark.slow
def test_friction_that_falls_with_the_temperature_is_foretold_at_another_one(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    traces = [trace(tmp_path, 3 + k, each) for k, each in enumerate(RECORDED_C)]
    found = diagnosed(machine_file, tmp_path, *traces)
    assert found["verdict"] in ("explained", "ambiguous")
    assert "warmup" in [each["name"] for each in found["effects"]]
    later = trace(tmp_path, 9, LATER_C)
    learned = torque_gap(tmp_path / "out" / "augmented.toml", later, capsys)
    assert learned < 0.3 * torque_gap(machine_file, later, capsys)


def test_a_part_that_goes_on_from_another_joins_it_and_a_copy_is_left_out(machine: Machine) -> None:
    one, part, other = (frame(start_s, 60.0, 21.0 + start_s) for start_s in (0.0, 60.0, 500.0))
    given = ([one] * 3, 1, 60.0), ([one, part], 1, 120.0), ([one, other], 2, 120.0)
    for files, counted, lasts_s in given:
        runs = runs_of(files, rigid_baseline(machine))
        assert len({run.recording for run in runs}) == counted
        assert sum(run.duration_s for run in runs) == pytest.approx(lasts_s, abs=0.5)
