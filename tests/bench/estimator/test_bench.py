"""The estimator's bench: what it scores, and that it hides nothing."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.simulation import ThesisPlant

from ... import foreign_plant
from .aims import AIMS, Aim
from .parts import PARTS
from .plants.foreign import ROW, scenarios
from .plants.own import Part
from .plants.thesis import edge_noise_var, thesis_machine, thesis_runs, torque_noise_var
from .rows import table_of
from .scores import Score, Track, detection, pooled, score
from .tasks import BenchSettings, tasks_of


def track(percent: Floats, truth: Floats, half_width: float = 0.5) -> Track:
    time_s = 0.1 * np.arange(1, len(percent) + 1)
    return Track(time_s, truth, percent, percent - half_width, percent + half_width, 0.5 * time_s)


def test_a_score_is_what_its_names_say() -> None:
    percent = np.array([5.0, 5.2, math.nan, 4.0])
    one = score(track(percent, np.full(4, 5.0)))
    assert (one.moments, one.answered) == (4, 3)
    assert one.mae == pytest.approx((0.0 + 0.2 + 1.0) / 3.0)
    assert one.worst == pytest.approx(1.0)
    assert one.false_drop == pytest.approx(1.0)
    assert one.coverage == pytest.approx(2.0 / 3.0)
    # widths of 1, and one truth half a point outside
    assert one.interval_score == pytest.approx(1.0 + 40.0 * 0.5 / 3.0)
    assert one.misleading == pytest.approx(1.0 / 4.0)
    assert one.wrong == 0.0  # half a point outside is not yet more than half a point


def test_confidently_wrong_is_a_share_of_the_numbers_given() -> None:
    percent = np.array([5.0, math.nan, 3.9, 6.1, 5.9])
    one = score(track(percent, np.full(5, 5.0)))
    assert one.wrong == pytest.approx(2.0 / 4.0)
    silent = score(track(np.full(2, math.nan), np.full(2, 5.0)))
    assert math.isnan(silent.wrong)
    assert pooled([one, silent, one]).wrong == pytest.approx(0.5)
    assert pooled([one, silent, one]).cases == 3


def test_a_false_drop_counts_from_the_event_on() -> None:
    percent = np.array([3.0, 5.0, 4.8])
    assert score(track(percent, np.full(3, 5.0)), event_s=0.15).false_drop == pytest.approx(0.2)


def test_detection_is_counted_in_motion() -> None:
    percent = np.array([5.0] * 10 + [5.0, 5.0, 1.0, 1.0])
    truth = np.array([5.0] * 10 + [0.0] * 4)
    seen = track(percent, truth)
    # the loss at 1.0 s is seen at 1.3 s, and the axis moves half of the time
    assert detection(seen, 1.0, 2.5) == pytest.approx(0.15)
    assert math.isinf(detection(track(np.full(14, 5.0), truth), 1.0, 2.5))
    early = np.where(np.arange(14) > 7, 1.0, 5.0)
    assert math.isinf(detection(track(early, truth), 1.0, 2.5))


def test_pooling_weighs_by_moments_and_keeps_the_worst() -> None:
    first = score(track(np.full(3, 5.0), np.full(3, 5.0)))
    second = score(track(np.full(1, 6.0), np.full(1, 5.0)))
    silent = score(track(np.full(4, math.nan), np.full(4, 5.0)))
    both = pooled([first, second, silent])
    assert both.mae == pytest.approx(0.25)
    assert both.worst == pytest.approx(1.0)
    assert (both.moments, both.answered) == (8, 4)


def test_an_unmeasured_figure_meets_no_aim() -> None:
    silent = Score(10, 0)
    assert not Aim(mae=0.1).met(silent, None)
    assert not Aim(detection_s=1.0).met(Score(1, 1, detection_s=math.inf), None)
    assert not Aim(added=0.1, reference="calibration exact").met(Score(1, 1, mae=0.1), None)
    assert Aim(misleading=0.0).met(silent, None)


def test_missed_aims_are_printed_as_missed_and_rows_without_data_stay() -> None:
    row = "closed loop: constant"
    bad = Score(1, 1, mae=9.0, worst=9.0, coverage=0.0, interval_score=1.0, false_drop=0.0)
    text = table_of([Part(row, bad)]).as_text()
    lines = {line.split("  ")[0]: line for line in text.splitlines()}
    assert "MISSED" in lines[row]
    assert "no data" in lines["closed loop: full drop"]
    assert set(AIMS) <= set(lines)
    json.dumps(table_of([Part(row, bad)]).as_dict(), allow_nan=False)


def test_the_table_counts_each_confidently_wrong_number_once() -> None:
    one = replace(score(track(np.array([3.9, 5.0]), np.full(2, 5.0))), misleading=0.0)
    rows = ("closed loop: constant", f"{ROW}healthy", "thesis' simulation 1, after step 100")
    table = table_of([Part(row, one) for row in rows])
    assert "confidently wrong: 2 of 4 numbers in 2 cases" in table.as_text()
    line = next(line for line in table.as_text().splitlines() if line.startswith(rows[0]))
    assert line.removeprefix(rows[0]).split()[:3] == ["0.500", "2", "1"]


def test_parts_and_axes_are_chosen() -> None:
    every = tasks_of(BenchSettings(quick=True))
    assert {task.part for task in every} == {*PARTS} - {"second-plant"}
    few = tasks_of(BenchSettings(quick=True, parts=("rates",), seed=7, seeds=2))
    assert [task.name for task in few] == [
        f"wear axis {axis}, {state}" for state in ("cold", "warming up") for axis in (7, 8)
    ]
    shifts = tasks_of(BenchSettings(parts=("healthy",), healthy_minutes=90.0))
    planned = [(task.arguments[0], task.arguments[2], task.arguments[3]) for task in shifts]
    minutes = sum(count * each_s / 60.0 for _, count, each_s in planned)
    assert minutes == pytest.approx(90.0)


def test_every_scenario_of_the_second_plant_has_a_row() -> None:
    named = {f"{ROW}{name}" for name in scenarios(foreign_plant, False)}
    assert len(named) > 10
    assert named <= set(AIMS)


def test_the_rows_of_the_thesis_are_among_the_aims_and_beat_its_own_filter() -> None:
    parts = list(thesis_runs(7, 1))
    assert {part.row for part in parts} <= set(AIMS)
    compared = [(part.ours, part.thesis) for part in parts if part.thesis is not None]
    assert len(compared) == 4
    for ours, theirs in compared:
        assert ours.mae < 0.5 * theirs.mae


def test_the_noise_of_the_plant_of_the_thesis_is_that_of_its_angle() -> None:
    """Euler: the second difference errs by two of the angle, T of the speed, (1, -2, 1) read.

    Neighbouring steps share what the angle errs by: 30 of them err by no more than the ends.
    """
    plant, rng = ThesisPlant(), np.random.default_rng(1)
    count, step_s = 200_000, 0.1
    torque_nm_s = plant.inertia_kg_m2 / step_s
    walk = np.sqrt(plant.angle_noise_var_rad2) * rng.standard_normal(count + 1) / step_s
    kick = np.sqrt(plant.speed_noise_var_rad2_s2) * rng.standard_normal(count)
    reading = np.sqrt(plant.rotary_noise_var_rad2) * rng.standard_normal(count + 2) / step_s

    silent = replace(plant, rotary_noise_var_rad2=0.0)
    ends = 2.0 * torque_nm_s**2 * edge_noise_var(silent)
    simulated = float(np.var(torque_nm_s * (np.diff(walk) + kick)))
    assert torque_noise_var(silent) + ends == pytest.approx(simulated, rel=0.02)

    ends = 2.0 * torque_nm_s**2 * edge_noise_var(plant)
    both = torque_nm_s * (np.diff(walk) + kick + np.diff(reading, 2))
    steps = 30
    sums = both[: count - count % steps].reshape(-1, steps).sum(axis=1)
    assert steps * torque_noise_var(plant) + ends == pytest.approx(float(np.var(sums)), rel=0.05)
    assert MixturePreloadEstimator(thesis_machine()).estimate().preload_percent is None
