"""The published results, from the publication and from an independent study of the method."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edge_service.estimate.imm.bank import run_bank
from edge_service.estimate.imm.modes import THESIS_MODE_TRANSITION, weighted_level
from edge_service.offline.reproduce.simulation import (
    LEVELS,
    ThesisCase,
    bank_inputs,
    has_false_drop,
    mean_absolute_error,
    run_case,
    smoothed_preload,
    steps_to_see_drop,
)
from edge_service.offline.reproduce.thesis import (
    PUBLISHED_TABLE,
    Reproduction,
    mean_probability,
    reproduce,
)

SEEDS = range(100, 115)
INDEPENDENT_MAE = {1: 0.269, 2: 0.227, 3: 0.203, 4: 0.294}
"""Causal window of 20 steps, from an independent implementation, mean of 60 seeds."""


def estimates(case: ThesisCase, window: int) -> list[np.ndarray]:
    return [smoothed_preload(run_case(case, seed)[1].mode_probability, window) for seed in SEEDS]


@pytest.mark.parametrize("method", ["kf-imm", "sif-imm"])
@pytest.mark.parametrize("level", list(PUBLISHED_TABLE))
def test_table_4_2(level: float, method: str) -> None:
    published, linear, exponential = PUBLISHED_TABLE[level]
    probability = mean_probability(ThesisCase(level, method=method), range(5))  # type: ignore[arg-type]
    np.testing.assert_allclose(probability, published, atol=0.04)
    assert float(probability @ LEVELS) == pytest.approx(linear, abs=0.25)
    assert float(weighted_level(probability, LEVELS)) == pytest.approx(exponential, abs=0.2)


@pytest.mark.parametrize("simulation", list(INDEPENDENT_MAE))
def test_mean_absolute_error(simulation: int) -> None:
    case = ThesisCase(simulation)
    truth = case.true_preload_percent()
    error = np.mean([mean_absolute_error(e, truth) for e in estimates(case, 20)])
    assert error == pytest.approx(INDEPENDENT_MAE[simulation], abs=0.02)


def test_a_sudden_drop_is_seen_within_three_steps() -> None:
    case = ThesisCase(4)
    truth = case.true_preload_percent()
    delays = [steps_to_see_drop(estimate, truth) for estimate in estimates(case, 3)]
    assert all(delay is not None and delay <= 3 for delay in delays)


@pytest.mark.parametrize("window", [10, 20])
def test_constant_preload_gives_no_false_drop(window: int) -> None:
    assert not any(has_false_drop(estimate) for estimate in estimates(ThesisCase(3), window))


def test_sliding_innovation_filters_do_as_kalman_filters_do() -> None:
    truth = ThesisCase(5).true_preload_percent()
    kalman, sliding = (
        np.mean([mean_absolute_error(e, truth) for e in estimates(case, 20)])
        for case in (ThesisCase(1), ThesisCase(5, method="sif-imm"))
    )
    assert sliding == pytest.approx(kalman, abs=0.03)


def test_a_tenth_of_the_step_works_with_the_scaled_matrix_only() -> None:
    for level in (10.0, 5.0, 0.0):
        scaled = mean_probability(ThesisCase(level, step_s=0.01), range(1))
        assert float(weighted_level(scaled, LEVELS)) == pytest.approx(level, abs=0.3)
    case = ThesisCase(10.0, step_s=0.01)
    run, _ = run_case(case, 0)
    step, drives, start = bank_inputs(case, run)
    step = replace(step, mode_transition=THESIS_MODE_TRANSITION)
    printed = run_bank(step, drives, run.measurement, start).mode_probability.mean(axis=0)
    assert float(weighted_level(printed, LEVELS)) < 8.5


def test_scores() -> None:
    truth = np.array([10.0, 10.0, 0.0, 0.0, 0.0])
    assert steps_to_see_drop(np.array([9.0, 9.0, 9.0, 4.9, 0.0]), truth) == 2
    assert steps_to_see_drop(np.array([9.0, 1.0, 9.0, 9.0, 9.0]), truth) is None
    assert has_false_drop(np.append(np.full(30, 9.9), 7.4))
    assert not has_false_drop(np.append(np.zeros(20), np.full(30, 7.6)))
    assert mean_absolute_error(np.array([1.0, 3.0]), np.array([2.0, 1.0])) == 1.5


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Reproduction, list[str]]:
    folder = tmp_path_factory.mktemp("study") / "made" / "here"
    said: list[str] = []
    return folder, reproduce(folder, seeds=1, progress=said.append), said


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
    assert len(lines) == 3 + 5 + 1 + 2 + len(result.windows)
