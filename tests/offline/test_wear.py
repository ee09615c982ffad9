"""Dates stated of wearing screws against what came, and the account of them by hand."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t as student

from edge_service.cli.entry import main
from edge_service.offline.reproduce.wear import (
    Crossing,
    Date,
    WearTest,
    crossing,
    read_wear_test,
    study,
)

from ..bench.wear.bench import lives_of, share
from ..bench.wear.histories import WEARING, Law
from ..bench.wear.straight_line import Stage, interval_score, line_dates, paired_scores, tally

REAL = Path(__file__).parents[3] / "shared/data/xjtu_wear/lower_screw_drag_nm.txt"


def worn(percent: list[float]) -> WearTest:
    """A screw read every 10 h at 100 m/h."""
    time_h = 10.0 * np.arange(len(percent))
    return WearTest(time_h, 100.0 * time_h, 0.005 * np.array(percent))


def test_drag_torques_alone_are_a_test_whose_speed_rises(tmp_path: Path) -> None:
    file = tmp_path / "drag.txt"
    file.write_text("0.5\n" * 10)
    found = read_wear_test(file)
    np.testing.assert_allclose(found.time_h, 35.0 * np.arange(10))
    by_hand = 60.0 * 0.008 * np.array([0.0, 300.0 * 35.0, 300.0 * 140.0, 800.0 * 140.0])
    np.testing.assert_allclose(found.distance_m[[0, 1, 4, 8]], by_hand)


def test_a_wear_test_may_state_its_times_and_speeds(tmp_path: Path) -> None:
    file = tmp_path / "drag.csv"
    file.write_text("time_h,speed_rpm,drag_torque_nm\n0,100,0.5\n10,100,0.4\n15,200,0.3\n")
    found = read_wear_test(file)
    assert found.time_h.tolist() == [0.0, 10.0, 15.0]
    np.testing.assert_allclose(found.distance_m, 0.48 * np.array([0.0, 1000.0, 2000.0]))
    assert found.drag_nm.tolist() == [0.5, 0.4, 0.3]


def test_a_crossing_is_the_first_below_and_the_last_from_above() -> None:
    test = worn([100.0, 95.0, 85.0, 95.0, 85.0, 80.0])
    found = crossing(test, 90.0)
    assert (found.first_h, found.last_h) == (pytest.approx(15.0), pytest.approx(35.0))
    assert crossing(test, 50.0) == Crossing(math.inf, math.inf)
    assert math.isinf(crossing(worn([100.0, 85.0, 95.0]), 90.0).last_h)


def test_the_score_is_that_of_the_interval_and_the_middle() -> None:
    # K = 1 of Bracher et al. (2021): (|y - m| / 2 + alpha / 2 IS) / 1.5 with alpha = .1
    date = Date(100.0, 150.0, 300.0)
    assert interval_score(date, 200.0) == pytest.approx((25.0 + 0.05 * 200.0) / 1.5)
    missed = (0.5 * 250.0 + 0.05 * (200.0 + 20.0 * 100.0)) / 1.5
    assert interval_score(date, 400.0) == pytest.approx(missed)


def test_dates_are_held_against_what_came() -> None:
    said = {0.0: {}, 10.0: {90.0: Date(20, 30, 40)}, 20.0: {90.0: Date(50, 60, 70)}}
    said[40.0] = {90.0: Date(41, 42, 43)}
    asked = [Stage(at, 100.0, dates, {}) for at, dates in said.items()]
    found = tally(asked, {90.0: 35.0, 80.0: math.inf}, lambda stage: stage.trend)
    assert (found.asked, found.stated, found.held, found.said_after) == (3, 2, 1, 1)
    assert found.lead_h == {90.0: 25.0}
    assert found.coverage == 0.5
    assert paired_scores(asked, {90.0: 35.0}).shape == (0, 2)


def test_the_straight_line_has_the_band_of_least_squares() -> None:
    """Fieller's bounds are where the band of the line's mean meets the limit."""
    time_h = 10.0 * np.arange(12.0)
    percent = 100.0 - 0.1 * time_h + np.random.default_rng(2).standard_normal(12)
    test = WearTest(time_h, time_h, 0.005 * percent)
    limit = 80.0
    date = line_dates(test, (limit,))[limit]
    slope, level = np.polyfit(time_h, test.percent, 1)
    rest = test.percent - level - slope * time_h
    mean_h, sxx = time_h.mean(), np.sum((time_h - time_h.mean()) ** 2)
    sigma = np.sqrt(rest @ rest / 10.0)
    grid = np.linspace(0.0, 2000.0, 200_001)
    half = student.ppf(0.95, 10) * sigma * np.sqrt(1.0 / 12.0 + (grid - mean_h) ** 2 / sxx)
    line = level + slope * grid
    inside = grid[np.abs(line - limit) <= half]
    assert date.likely_h == pytest.approx((limit - level) / slope, rel=0.02)
    assert date.earliest_h == pytest.approx(inside[0], rel=0.03)
    assert date.latest_h == pytest.approx(inside[-1], rel=0.06)


def test_bands_hold_whatever_the_law_and_a_straight_line_is_beaten() -> None:
    parts = [lives_of(law, lives=3, seed=21) for law in WEARING]
    trend = [each for part in parts for each in part.trend]
    line = [each for part in parts for each in part.line]
    assert share(trend, "held", "stated") > 0.8
    assert share(trend, "held", "stated") > share(line, "held", "stated") + 0.2
    assert share(trend, "stated", "asked") > 0.5
    scores = np.concatenate([part.scores for part in parts]).mean(axis=0)
    assert scores[0] < scores[1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31, 32])
def test_nine_of_ten_bands_hold_over_all_laws(seed: int) -> None:
    parts = [lives_of(law, seed=seed) for law in WEARING]
    trend = [each for part in parts for each in part.trend]
    assert 0.85 <= share(trend, "held", "stated") <= 0.96
    assert share(trend, "stated", "asked") > 0.6
    scores = np.concatenate([part.scores for part in parts]).mean(axis=0)
    assert scores[0] < 0.8 * scores[1]


@pytest.mark.parametrize("law", ["none"])
def test_a_screw_that_does_not_wear_rarely_has_a_date(law: Law) -> None:
    part = lives_of(law, lives=8, seed=23)
    assert share(part.trend, "stated", "asked") < 0.2


@pytest.mark.skipif(not REAL.exists(), reason=f"needs {REAL}, a real screw's wear")
def test_a_real_screw_crosses_within_the_bands() -> None:
    found = study(read_wear_test(REAL))
    assert (found.held, found.stated) == (27, 28)
    assert {limit for stage in found.stages for limit in stage.dates} == {90.0, 85.0, 80.0}


def test_the_command_writes_table_json_and_picture(tmp_path: Path, capsys) -> None:
    percent = 100.0 - 2.0 * np.arange(14) + 0.3 * np.random.default_rng(4).standard_normal(14)
    file = tmp_path / "drag.txt"
    file.write_text("".join(f"{0.005 * each:.4f}\r\n" for each in percent))
    out = tmp_path / "out"
    assert main(["reproduce", "wear", str(file), "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "90% bands held what came" in text
    page = (out / "report.html").read_text()
    assert "bands held what came" in page
    assert "<svg" in page
    assert main(["reproduce", "wear", str(file), "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["stages"]) == 14
    assert found["crossings"]["90.0"]["first_h"] == pytest.approx(175.0, abs=20.0)


def test_a_screw_that_reaches_no_limit_is_told_so(tmp_path: Path, capsys) -> None:
    file = tmp_path / "drag.txt"
    file.write_text("0.5\n" * 9)
    assert main(["reproduce", "wear", str(file), "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "90 % of fresh: not reached" in text
    assert "nan" not in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.5\nx\n", "line 2: 'x'"),
        ("0.5\n", "2 lines"),
        ("0.5\n-1\n", "above 0"),
        ("time_h,drag_torque_nm\n0,1\n", "expected the columns time_h, speed_rpm"),
        ("time_h,speed_rpm,drag_torque_nm\n0,1,1\n0,1,1\n", "times that rise"),
    ],
)
def test_what_is_no_wear_test_is_one_line(tmp_path: Path, capsys, text: str, words: str) -> None:
    file = tmp_path / "drag.txt"
    file.write_text(text)
    assert main(["reproduce", "wear", str(file)]) == 2
    assert words in capsys.readouterr().err
    assert main(["reproduce", "wear"]) == 2
    assert "FILE" in capsys.readouterr().err
