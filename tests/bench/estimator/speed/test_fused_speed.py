"""Figures of speed, false alarms, and pictures of the estimator's bench."""

import math
from pathlib import Path

import numpy as np
import pytest

from edge_service.estimate.mixture.state import HYPOTHESES
from edge_service.offline.thesis.runs import ThesisCase, run_case

from ...table import Drawn, Figure
from .. import pictures as estimator_pictures
from ..healthy.false_alarms import count_false_alarms
from ..pictures import draw_estimator
from ..plants.thesis import thesis_blocks, thesis_machine
from ..scores import Track
from .fused_speed import INTERVAL_S, measure_fused_speed, phases_of

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.mark.parametrize(
    ("value", "at_most", "at_least", "met"),
    [
        (1.0, None, None, None),
        (1.0, 2.0, None, True),
        (3.0, 2.0, None, False),
        (3.0, None, 2.0, True),
        (1.0, None, 2.0, False),
        (1.5, 2.0, 1.0, True),
    ],
)
def test_a_figure_keeps_both_its_limits(
    value: float, at_most: float | None, at_least: float | None, met: bool | None
) -> None:
    assert Figure("key", "name", value, "", at_most, at_least).met is met


def test_phases_are_those_of_the_blocks() -> None:
    run, _ = run_case(ThesisCase(3), seed=0)
    blocks = thesis_blocks(run)
    phases = phases_of(thesis_machine(), blocks)
    assert phases.blocks == len(blocks)
    assert len(phases.readings) == sum(len(block.phases) for block in blocks)
    last_s = max(block.time_s for block in blocks if block.phases)
    assert phases.elapsed_s.sum() == pytest.approx(last_s)


def test_a_fleet_takes_longer_than_an_axis_and_answers_longer_than_updates() -> None:
    run, _ = run_case(ThesisCase(3), seed=0)
    speed = measure_fused_speed(thesis_machine(), thesis_blocks(run)[:300], axes=2, repeats=1)
    assert speed.kernel_s_per_phase > 0.0
    assert speed.settled_s_per_phase > 0.0
    assert speed.fleet_s_per_block > 0.0
    assert speed.update_s_per_block > speed.kernel_s_per_phase
    assert 1.0 <= speed.hypotheses <= HYPOTHESES
    assert 1.0 <= speed.settled_hypotheses <= HYPOTHESES


def test_false_alarms_are_counted_per_million_steps() -> None:
    found = count_false_alarms(runs=2)
    assert 1000 < found.steps < 2000
    for figure, count in zip(found.figures(), (found.of_a_drop, found.of_a_step), strict=True):
        assert figure.value == pytest.approx(count * 1e6 / found.steps)


def test_each_row_has_a_picture_and_all_of_them_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time_s = INTERVAL_S * np.arange(1, 50)
    percent = np.where(time_s < 2.0, math.nan, 5.0)
    track = Track(time_s, np.full(49, 5.0), percent, percent - 1.0, percent + 1.0, time_s)
    rows = [Drawn("thesis' row: one", track), Drawn("silent", track.since(45))]
    monkeypatch.setattr(estimator_pictures, "tracks", lambda quick: iter(rows))
    files = draw_estimator(tmp_path / "new")
    names = ["thesis_row_one.png", "silent.png", "estimator.png"]
    assert [file.name for file in files] == names
    assert all(file.read_bytes().startswith(PNG) for file in files)
