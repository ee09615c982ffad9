"""Lives of an axis: how they are drawn, followed and scored."""

import math
from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.stats import spearmanr

from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import Floats

from ..estimator.axis import OwnAxis, downsampled
from ..estimator.scores import Recorded, Track, follow, score
from ..table import Section, cell, mean_of
from .bench import KEPT, NEW, KeptEstimator, LifePart, drawn_life, life_section, live
from .cases import DAY_S, SHAPES, Life, draw_life
from .plants import plant_of
from .scores import crossing_day, joined, life_score, rank_correlation, session_ends

FRESH = 7.0


def tracks_of(life: Life, error: Floats, half_width: float = 0.5) -> list[Track]:
    """Every session read with one error, three numbers each; an error of NaN is silence."""
    tracks = []
    for session, off in zip(life.sessions, error, strict=True):
        time_s = session.clock_s + np.array([1.0, 2.0, session.duration_s])
        truth = np.full(3, session.percent[-1])
        percent = truth + off
        tracks.append(
            Track(time_s, truth, percent, percent - half_width, percent + half_width, time_s)
        )
    return tracks


def test_the_day_of_a_crossing_lies_straight_between_two_sessions() -> None:
    day = np.array([0.0, 10.0, 20.0, 30.0])
    # from 5 to 3 within ten days: 4.2 is left after four of them
    assert crossing_day(day, np.array([6.0, 5.0, 3.0, 2.0]), 4.2) == pytest.approx(14.0)
    assert crossing_day(day, np.array([6.0, math.nan, 3.0, 2.0]), 4.5) == pytest.approx(10.0)
    assert crossing_day(day, np.array([2.0, 2.0, 2.0, 2.0]), 4.2) == 0.0


def test_one_low_number_is_no_crossing_but_the_last_may_be() -> None:
    day = np.array([0.0, 10.0, 20.0, 30.0])
    assert math.isinf(crossing_day(day, np.array([6.0, 3.0, 6.0, 6.0]), 4.2))
    assert crossing_day(day, np.array([6.0, 6.0, 6.0, 3.0]), 4.5) == pytest.approx(25.0)
    assert math.isinf(crossing_day(day, np.full(4, math.nan), 4.2))


def test_rank_correlation_is_spearmans() -> None:
    first = np.array([3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0])
    second = np.array([2.0, 7.0, 1.0, 8.0, 2.0, 8.0, 1.0])
    assert rank_correlation(first, second) == pytest.approx(spearmanr(first, second).statistic)
    assert rank_correlation(first, np.exp(first)) == pytest.approx(1.0)
    holed = np.append(first, math.nan)
    assert rank_correlation(holed, np.append(-first, 1.0)) == pytest.approx(-1.0)
    assert math.isnan(rank_correlation(first, np.full(7, 5.0)))


def test_a_life_is_scored_by_the_ends_of_its_sessions() -> None:
    life = draw_life("linear", 1, FRESH, 5)
    error = np.array([0.2, -0.2, 1.5, math.nan, -0.1])
    found = life_score(life, tracks_of(life, error))
    assert found.ends_mae == pytest.approx((0.2 + 0.2 + 1.5 + 0.1) / 4.0)
    lost = [FRESH - session.percent[-1] for session in life.sessions]
    assert found.fresh_mae == pytest.approx(sum(lost[k] for k in (0, 1, 2, 4)) / 4.0)
    assert (found.sessions, found.silent) == (5, 1)
    assert (found.rows.moments, found.rows.answered) == (15, 12)
    assert found.rows.wrong == pytest.approx(3.0 / 12.0)  # 1.5 off, 1.0 outside
    assert found.rows.coverage == pytest.approx(9.0 / 12.0)


def test_the_date_of_a_crossing_errs_by_a_share_of_the_life() -> None:
    # 1 - .65 a = .6: straight between sessions, so read without an error it is found exactly
    life = draw_life("linear", 2, FRESH, 9)
    assert life.crossing_day() == pytest.approx(0.4 / 0.65 * life.days, rel=1e-3)
    exact = life_score(life, tracks_of(life, np.zeros(9)))
    assert exact.crossing == pytest.approx(0.0, abs=1e-3)
    assert exact.rank == pytest.approx(1.0)
    # read .65 points of 7 too high it is found so much later: .65 / (.65 * 7) of the life
    late = life_score(life, tracks_of(life, np.full(9, 0.65)))
    assert late.crossing == pytest.approx(1.0 / 7.0, abs=2e-3)
    blind = life_score(life, tracks_of(life, np.full(9, 5.0)))
    assert math.isinf(blind.crossing)


def test_a_healthy_life_has_no_date_and_one_found_is_false() -> None:
    life = draw_life("healthy", 1, FRESH, 4)
    right, wrong = (life_score(life, tracks_of(life, np.full(4, off))) for off in (0.0, -4.0))
    assert math.isnan(right.crossing)
    assert math.isnan(right.rank)
    assert not right.false_crossing
    assert wrong.false_crossing


@pytest.mark.parametrize("axis_seed", [1, 2])
def test_sessions_are_joined_and_ended_on_any_clock(axis_seed: int) -> None:
    life = draw_life("linear", axis_seed, FRESH, 4)
    tracks = tracks_of(life, np.zeros(4))
    whole = joined(life, tracks)
    duration_s = life.sessions[0].duration_s
    assert whole.time_s[-1] == pytest.approx(4 * duration_s)
    assert (np.diff(whole.time_s) > 0.0).all()
    ends = session_ends(life, tracks)
    days = [session.day + duration_s / DAY_S for session in life.sessions]
    assert ends.day == pytest.approx(np.array(days))


@pytest.mark.parametrize("shape", SHAPES)
def test_the_preload_of_a_life_only_falls_but_for_a_new_nut(shape: str) -> None:
    life = draw_life(shape, 5, FRESH, 16)
    percent = np.concatenate([session.percent for session in life.sessions])
    rises = np.diff(percent)[np.diff(percent) > 1e-9]
    assert percent[0] == pytest.approx(FRESH)
    assert (percent > 0.0).all()
    assert len(rises) == (1 if shape == "replaced nut" else 0)
    days = np.array([session.day for session in life.sessions])
    assert (np.diff(days) > 0.0).all()
    assert days[-1] == pytest.approx(life.days)


def test_a_step_falls_within_a_session() -> None:
    life = draw_life("sudden step", 4, FRESH, 16)
    falls = [session.percent[0] - session.percent[-1] for session in life.sessions]
    assert sum(fall > 0.39 * FRESH for fall in falls) == 1


def test_sessions_differ_and_a_seed_says_all() -> None:
    life, again = draw_life("linear", 3, FRESH), draw_life("linear", 3, FRESH)
    assert life == again
    assert life != draw_life("linear", 4, FRESH)
    for name in ("warmth", "nut", "guide", "viscous", "seed"):
        drawn = [getattr(session, name) for session in life.sessions]
        assert len(set(drawn)) > len(drawn) // 2, name
    for session in life.sessions:
        assert 0.1 <= abs(session.nut - 1.0) <= 0.2
        assert 0.1 <= abs(session.guide - 1.0) <= 0.2
        assert session.nut != session.guide


def test_both_clocks_occur() -> None:
    lives = [draw_life("linear", axis, FRESH, 4) for axis in range(1, 9)]
    assert {life.own_clock for life in lives} == {True, False}
    for life in lives:
        expected = [0.0 if life.own_clock else session.day * DAY_S for session in life.sessions]
        assert [session.clock_s for session in life.sessions] == expected


class Remembering:
    """An estimator that only remembers what was done with it."""

    def __init__(self) -> None:
        self.done: list[str] = []

    def update(self, block: FeatureBlock) -> None:
        self.done.append("update")

    def estimate(self) -> PreloadEstimate:
        return PreloadEstimate(time_s=0.0, status=EstimateStatus.UNESTIMATED, data_used_s=0.0)

    def interrupt(self) -> None:
        self.done.append("interrupt")

    def resume(self, stopped_s: float) -> None:
        self.done.append("resume")

    def reset(self) -> None:
        self.done.clear()

    def snapshot(self) -> dict[str, list[str]]:
        return {"done": self.done}

    def restore(self, snapshot: dict[str, list[str]]) -> None:
        self.done = [*snapshot["done"], "restore"]


@pytest.mark.parametrize(("later_s", "resumed"), [(0.0, True), (DAY_S, False)])
def test_a_kept_state_goes_on_as_the_command_does(later_s: float, resumed: bool) -> None:
    axis, percent = OwnAxis(), np.full(1500, FRESH)
    blocks = downsampled(axis.frames("production", percent, 1), axis.nominal())
    later = [replace(block, time_s=block.time_s + later_s) for block in blocks]
    made: list[Remembering] = []

    def make() -> Remembering:
        made.append(Remembering())
        return made[-1]

    kept = KeptEstimator(make)
    times = np.arange(1500) / 1e3
    kept.follow(Recorded(blocks, times, percent))
    kept.follow(Recorded(later, times + later_s, percent))
    updates = ["update"] * len(blocks)
    between = ["restore", *(["resume"] if resumed else [])]
    assert made[-1].done == [*updates, *between, *updates]


def test_a_section_is_an_aligned_table_and_rows_for_a_program() -> None:
    rows = (("first", (0.25, 3, math.nan)), ("second", (math.inf, 4, (1.0, math.inf))))
    section = Section("life", "what", ("MAE ends", "rows", "seen s"), rows, ("a note",))
    lines = section.as_text().splitlines()
    assert len({len(line) for line in lines[:2]}) == 1
    assert lines[1].split() == ["first", "0.250", "3", "-"]
    assert lines[-1] == "a note"
    rows = section.as_dict()["rows"]
    assert rows[0] == {"row": "first", "mae_ends": 0.25, "rows": 3, "seen_s": None}
    assert rows[1]["seen_s"] == [1.0, "never"]
    assert cell(()) == "-"
    assert mean_of([1.0, math.inf, math.nan, 3.0]) == pytest.approx(2.0)


def test_sessions_are_pooled_by_the_state_in_which_they_begin() -> None:
    life = draw_life("linear", 3, FRESH, 16)
    off = [2.0 if session.start == "warm, with payload" else 0.0 for session in life.sessions]
    tracks = tracks_of(life, np.array(off))
    part = LifePart("own", life, NEW, life_score(life, tracks), joined(life, tracks))
    rows = {row["row"]: row for row in life_section([part]).as_dict()["rows"]}
    states = {session.start for session in life.sessions}
    assert len(states) == 4
    begun = {state: rows[f"own, new, begun {state}"] for state in states}
    assert sum(row["sessions"] for row in begun.values()) == 16
    for state, row in begun.items():
        assert row["wrong"] == (1.0 if state == "warm, with payload" else 0.0)
        assert row["mae_ends"] is None


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["foreign", "own"])
def test_a_short_life_is_lived_in_both_ways(plant: str) -> None:
    parts = list(live(plant, "replaced nut", 3, True))
    assert [part.way for part in parts] == [KEPT, NEW]
    for part in parts:
        assert part.score.rows.answered > 0.5 * part.score.rows.moments
        assert asdict(part.score)["sessions"] == len(part.life.sessions)
    table = life_section(parts).as_text()
    assert f"{plant}, replaced nut, kept" in table
    assert f"{plant}, all lives, new" in table


def test_a_worn_screw_is_not_read_as_fresh_where_its_growth_is_large() -> None:
    """The last session of a life, 2.4 of 6.8 points left, the screw warm: read as 5.7 once."""
    plant = plant_of("foreign", 5)
    worn = drawn_life(plant, "linear", 5, False).sessions[-1]
    assert worn.warmth > 0.9
    found = score(follow(plant.estimator(), plant.recorded(worn)).since(20))
    assert found.answered > 1000
    assert found.wrong == 0.0
    assert found.mae < 1.0


@pytest.mark.slow
def test_wear_over_months_is_followed_on_an_axis_that_no_rule_was_set_on() -> None:
    """Loads of 10 kg on a table of 23 kg, warm and cold: a fifth was wrong once, 0.7 points off."""
    parts = live("foreign", "linear", 6, False)
    kept = next(part.score for part in parts if part.way == KEPT)
    assert kept.rows.wrong < 0.01
    assert kept.ends_mae < 0.6
    assert kept.rank > 0.9
