"""The published results, from the publication and independently; the plant by other mathematics."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edge_service.command_answer import LISTENER
from edge_service.estimate.imm.bank import run_bank
from edge_service.estimate.imm.modes import THESIS_MODE_TRANSITION, weighted_level
from edge_service.offline.reproduce import simulation as drive
from edge_service.offline.reproduce.thesis import (
    PUBLISHED_TABLE,
    Reproduction,
    mean_probability,
    reproduce,
)

SEEDS = range(100, 115)
INDEPENDENT_MAE = {1: 0.269, 2: 0.227, 3: 0.203, 4: 0.294}
"""Causal window of 20 steps, from an independent implementation, mean of 60 seeds."""


def estimates(case: drive.ThesisCase, window: int) -> list[np.ndarray]:
    return [
        drive.smoothed_preload(drive.run_case(case, seed)[1].mode_probability, window)
        for seed in SEEDS
    ]


@pytest.mark.parametrize("method", ["kf-imm", "sif-imm"])
@pytest.mark.parametrize("level", list(PUBLISHED_TABLE))
def test_table_4_2(level: float, method: str) -> None:
    published, linear, exponential = PUBLISHED_TABLE[level]
    probability = mean_probability(drive.ThesisCase(level, method=method), range(5))  # type: ignore[arg-type]
    np.testing.assert_allclose(probability, published, atol=0.04)
    assert float(probability @ drive.LEVELS) == pytest.approx(linear, abs=0.25)
    assert float(weighted_level(probability, drive.LEVELS)) == pytest.approx(exponential, abs=0.2)


@pytest.mark.parametrize("simulation", list(INDEPENDENT_MAE))
def test_mean_absolute_error(simulation: int) -> None:
    case = drive.ThesisCase(simulation)
    truth = case.true_preload_percent()
    error = np.mean([drive.mean_absolute_error(e, truth) for e in estimates(case, 20)])
    assert error == pytest.approx(INDEPENDENT_MAE[simulation], abs=0.02)


def test_a_sudden_drop_is_seen_within_three_steps() -> None:
    case = drive.ThesisCase(4)
    truth = case.true_preload_percent()
    delays = [drive.steps_to_see_drop(estimate, truth) for estimate in estimates(case, 3)]
    assert all(delay is not None and delay <= 3 for delay in delays)


@pytest.mark.parametrize("window", [10, 20])
def test_constant_preload_gives_no_false_drop(window: int) -> None:
    assert not any(
        drive.has_false_drop(estimate) for estimate in estimates(drive.ThesisCase(3), window)
    )


def test_sliding_innovation_filters_do_as_kalman_filters_do() -> None:
    truth = drive.ThesisCase(5).true_preload_percent()
    kalman, sliding = (
        np.mean([drive.mean_absolute_error(e, truth) for e in estimates(case, 20)])
        for case in (drive.ThesisCase(1), drive.ThesisCase(5, method="sif-imm"))
    )
    assert sliding == pytest.approx(kalman, abs=0.03)


def test_a_tenth_of_the_step_works_with_the_scaled_matrix_only() -> None:
    for level in (10.0, 5.0, 0.0):
        scaled = mean_probability(drive.ThesisCase(level, step_s=0.01), range(1))
        assert float(weighted_level(scaled, drive.LEVELS)) == pytest.approx(level, abs=0.3)
    case = drive.ThesisCase(10.0, step_s=0.01)
    run, _ = drive.run_case(case, 0)
    step, drives, start = drive.bank_inputs(case, run)
    step = replace(step, mode_transition=THESIS_MODE_TRANSITION)
    printed = run_bank(step, drives, run.measurement, start).mode_probability.mean(axis=0)
    assert float(weighted_level(printed, drive.LEVELS)) < 8.5


def test_scores() -> None:
    truth = np.array([10.0, 10.0, 0.0, 0.0, 0.0])
    assert drive.steps_to_see_drop(np.array([9.0, 9.0, 9.0, 4.9, 0.0]), truth) == 2
    assert drive.steps_to_see_drop(np.array([9.0, 1.0, 9.0, 9.0, 9.0]), truth) is None
    assert drive.has_false_drop(np.append(np.full(30, 9.9), 7.4))
    assert not drive.has_false_drop(np.append(np.zeros(20), np.full(30, 7.6)))
    assert drive.mean_absolute_error(np.array([1.0, 3.0]), np.array([2.0, 1.0])) == 1.5


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Reproduction, list[str]]:
    folder = tmp_path_factory.mktemp("study") / "made" / "here"
    said: list[str] = []
    LISTENER.set(said.append)
    return folder, reproduce(folder, seeds=1, window_steps=15), said


def test_writes_both_files_and_nothing_else(written: tuple[Path, Reproduction, list[str]]) -> None:
    folder, result, said = written
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "reproduction.json"]
    numbers = json.loads((folder / "reproduction.json").read_text())
    assert numbers["schema"] == "reproduction/1"
    assert [row["percent"] for row in numbers["levels"]] == [row.percent for row in result.levels]
    assert said


def test_page_is_self_contained_and_complete(written: tuple[Path, Reproduction, list[str]]) -> None:
    page = (written[0] / "report.html").read_text()
    assert not re.search(r'(src|href)="(?!#)', page.replace("xlink:href", "href"))
    assert not re.search(r"@import|url\((?!#)|<script", page)
    for number in ("4.3", "4.4", "4.5", "4.6", "4.7", "4.8", "4.9", "4.10"):
        assert f"Figure {number}:" in page
    targets = set(re.findall(r'<a href="#([^"]+)"', page))
    assert targets <= set(re.findall(r' id="([^"]+)"', page))
    assert page.count("<svg") == 8


def test_text_has_a_line_per_row(written: tuple[Path, Reproduction, list[str]]) -> None:
    result = written[1]
    lines = result.as_text().splitlines()
    for row in result.levels:
        assert any(f"{row.percent:5.2f} ({row.published_percent:4.1f})" in line for line in lines)
    assert len(lines) == 3 + 5 + 1 + 2 + len(result.windows) + 1
    assert "window of 15: " in lines[-1]
    low, high = re.findall(r"\d+\.\d", lines[-1].partition("(")[0])
    assert 95.0 < float(low) < float(high) < 98.5  # published: 95 to 98 %


def test_euler_matrices_are_the_printed_ones() -> None:
    ratio, step_s = 0.02 / (2 * np.pi), 0.1
    transition, push = drive.plant_matrices()
    np.testing.assert_allclose(
        transition,
        [[1, step_s, 0], [0, 1 - 1.98e-2 * step_s / 3.3e-3, 0], [ratio, ratio * step_s, 0]],
        rtol=1e-14,
    )
    np.testing.assert_allclose(push, [0.0, step_s / 3.3e-3, 0.0])
    np.testing.assert_allclose(drive.PROCESS_VARIANCE, [1e-3, 1e-2, ratio * 1e-3])
    np.testing.assert_allclose(drive.READING_VARIANCE, [1e-4, 2e-5])


def test_drag_leaves_nothing_of_a_torque_below_it() -> None:
    torque = np.array([0.5, -0.5, 0.2, -0.2, 0.3, 0.0])
    np.testing.assert_allclose(drive.net_torque(torque, np.array(0.3)), [0.2, -0.2, 0, 0, 0, 0])


def test_without_noise_the_speed_is_that_of_the_differential_equation() -> None:
    """Steady oscillation of J w' + D w = 2 sin t without drag: amplitude 2 / |D + i J|."""
    transition, push = drive.plant_matrices(5e-4)
    state = drive.follow(transition, np.outer(2.0 * np.sin(5e-4 * np.arange(50_000)), push))
    amplitude = 2.0 / abs(complex(1.98e-2, 3.3e-3))
    assert np.abs(state[20_000:, 1]).max() == pytest.approx(amplitude, rel=1e-3)


def test_noise_has_the_printed_variance() -> None:
    run = drive.simulate(np.full(4000, 10.0), np.random.default_rng(1))
    transition, push = drive.plant_matrices()
    before = np.vstack([np.zeros(3), run.state[:-1]])
    disturbance = run.state - before @ transition.T - np.outer(run.net_torque_nm, push)
    reading = run.measurement - run.state[:, [0, 2]]
    variances = [*disturbance.var(axis=0), *reading.var(axis=0)]
    expected = [*drive.PROCESS_VARIANCE, *drive.READING_VARIANCE]
    np.testing.assert_allclose(variances, expected, rtol=0.1)


def test_the_same_seed_gives_the_same_run() -> None:
    runs = [drive.simulate(np.full(50, 5.0), np.random.default_rng(3)) for _ in range(2)]
    assert np.array_equal(runs[0].measurement, runs[1].measurement)


@pytest.mark.parametrize(
    ("simulation", "first", "middle", "last"),
    [(1, 10, 5, 0), (2, 7.5, 5, 2.5), (3, 10, 10, 10), (4, 10, 0, 0), (5, 10, 5, 0)],
)
def test_profiles(simulation: int, first: float, middle: float, last: float) -> None:
    profile = drive.preload_profile(simulation, np.array([0.0, 50.0, 100.0]))
    assert profile.tolist() == [first, middle, last]


def test_the_filter_of_the_true_mode_is_consistent() -> None:
    """NIS of a matched filter with two sensors has mean 2."""
    case = drive.ThesisCase(5.0)
    run, _ = drive.run_case(case, 1)
    step, drives, start = drive.bank_inputs(case, run)
    matched = run_bank(
        replace(step, drive=drives[0, 2:3], mode_transition=np.ones((1, 1))),
        drives[:, 2:3],
        run.measurement,
        replace(start, mode_probability=np.ones(1)),
    )
    assert matched.nis.mean() == pytest.approx(2.0, abs=4 * np.sqrt(4.0 / len(drives)))
