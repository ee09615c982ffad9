"""Preload of an axis with one encoder by tests, on axes drawn from another model."""

import itertools
import json
import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.interface import make_estimator
from edge_service.estimate.one_encoder import OneEncoderEstimator
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.models.machine import Machine
from edge_service.nodes.stages import make_downsampler

from ..fingerprint.shaken_axis import Axis, driven, smooth
from .tested_axis import FRESH_PERCENT, as_it_is, drawn, machine_of, on_a_day

DAY_S = 86400.0
AXIS = Axis(share=0.3, guide_n=30.0)
HALF = replace(AXIS, preload=0.5)


def commissioned(axis: Axis, seed: int = 1, days: int = 3) -> Machine:
    random = np.random.default_rng(seed)
    return machine_of(axis, [as_it_is(on_a_day(axis, random)) for _ in range(days)])


MACHINE = commissioned(AXIS)


def estimator(machine: Machine = MACHINE) -> OneEncoderEstimator:
    made = make_estimator("mixture", machine)
    assert isinstance(made, OneEncoderEstimator)
    return made


def bounds(estimate: PreloadEstimate) -> tuple[float, float]:
    assert estimate.low is not None and estimate.high is not None
    return estimate.low, estimate.high


def width(estimate: PreloadEstimate) -> float:
    low, high = bounds(estimate)
    return high - low


def holds(estimate: PreloadEstimate, preload: float) -> bool:
    low, high = bounds(estimate)
    return low <= FRESH_PERCENT * preload <= high


def production(axis: Axis) -> list[FeatureBlock]:
    """Half a minute of moves to and fro."""
    speed = smooth([0.0, 0.2, 0.2, 0.0, -0.2, -0.2] * 5 + [0.0])
    return make_downsampler(MACHINE).push(driven(axis, speed, 2))


@pytest.fixture(scope="module")
def moves() -> list[FeatureBlock]:
    return production(AXIS)


@pytest.fixture(scope="module")
def worn_moves() -> list[FeatureBlock]:
    return production(HALF)


def after(made: OneEncoderEstimator, blocks: list[FeatureBlock]) -> PreloadEstimate:
    for block in blocks:
        made.update(block)
    return made.estimate()


@pytest.mark.parametrize("preload", [1.0, 0.75, 0.5, 0.25, 0.1])
def test_a_test_tells_how_much_preload_is_left(preload: float) -> None:
    told = estimator().take_test(as_it_is(replace(AXIS, preload=preload)), 40.0)
    assert told.status is EstimateStatus.ESTIMATED
    assert told.preload_percent == pytest.approx(FRESH_PERCENT * preload, abs=1.8)
    assert [holds(told, each) for each in (preload, 1.0)] == [True, preload == 1.0]
    assert 0.5 <= width(told) < 4.0
    assert sum(told.mode_probability.values()) == pytest.approx(1.0)


def test_a_test_halves_the_interval_of_torque_alone(worn_moves: list[FeatureBlock]) -> None:
    untested = after(estimator(), worn_moves)
    assert width(estimator().take_test(as_it_is(HALF), 40.0)) < 0.5 * width(untested)


def test_an_axis_that_is_never_tested_is_estimated_as_one_without_tests(
    worn_moves: list[FeatureBlock],
) -> None:
    assert MACHINE.commissioned is not None
    learned = MACHINE.commissioned.model_copy(update={"notch": None})
    other = make_estimator("mixture", MACHINE.model_copy(update={"commissioned": learned}))
    for block in worn_moves:
        other.update(block)
    now, plain = after(estimator(), worn_moves), other.estimate()
    expected = width(estimator().take_test(as_it_is(AXIS), 40.0))
    assert now.reasons[-1].startswith("test_due: no test yet, and the interval is ")
    assert float(now.reasons[-1].split()[-2]) == pytest.approx(expected, abs=0.3)
    assert now.model_copy(update={"reasons": ()}) == plain


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"place_rad": 0.3 / AXIS.radius_m}, "another place"),
        ({"feed_rad_s": 0.012 / AXIS.radius_m}, "a feed of"),
        ({"inertia_ratio": 0.6, "inertia_ratio_sigma": 0.1}, "another payload"),
    ],
)
def test_a_test_that_is_not_that_of_commissioning_is_refused(
    change: dict[str, float], reason: str
) -> None:
    made = estimator()
    with pytest.raises(ValueError, match=reason):
        made.take_test(as_it_is(AXIS).model_copy(update=change), 40.0)
    assert made.snapshot()["test"] is None


@pytest.mark.parametrize("preload", [1.0, 0.5])
@pytest.mark.parametrize(
    "change",
    [{"friction": 0.7}, {"friction": 1.25}, {"guide_n": 60.0}, {"payload_kg": 20.0}],
    ids=str,
)
def test_warmth_grease_guides_and_payload_move_the_answer_by_little_or_widen_it(
    change: dict[str, float], preload: float
) -> None:
    axis = replace(AXIS, preload=preload)
    plain = estimator().take_test(as_it_is(axis), 40.0)
    told = estimator().take_test(as_it_is(replace(axis, **change)), 40.0)  # type: ignore[arg-type]
    assert holds(told, preload)
    assert told.preload_percent is not None
    assert plain.preload_percent is not None
    moved = abs(told.preload_percent - plain.preload_percent)
    assert moved < 0.5 or width(told) > width(plain) + moved - 0.5


@pytest.mark.parametrize("softer", [0.8, 1.1, 1.2, 1.4, 1.8, 6.0])
def test_a_rest_that_has_changed_is_not_called_lost_preload(softer: float) -> None:
    """The level of friction is that of the fresh screw."""
    told = estimator().take_test(as_it_is(replace(AXIS, softer=softer)), 40.0)
    assert holds(told, 1.0)
    assert [reason[:13] for reason in told.reasons] == ["rest_changed:"] * (softer != 1.1)


def test_between_tests_answer_widens_and_is_never_narrower(worn_moves: list[FeatureBlock]) -> None:
    made = estimator()
    told = [made.take_test(as_it_is(HALF), 0.0)]
    for days in (0.0, 3.0, 6.0, 20.0):
        moved = [replace(block, time_s=block.time_s + DAY_S * days) for block in worn_moves]
        told.append(after(made, moved))
    assert all(holds(each, 0.5) for each in told)
    widths = [width(each) for each in told]
    assert all(b > a - 1e-9 for a, b in itertools.pairwise(widths))
    due = [any(reason.startswith("test_due") for reason in each.reasons) for each in told]
    assert due == [False, False, False, False, True]
    assert "the last test was 20 days ago" in told[-1].reasons[-1]


def test_friction_that_no_grease_takes_away_overrules_an_old_test(
    worn_moves: list[FeatureBlock],
) -> None:
    """The last test has found a fresh screw; now the whole drag of the nut is gone."""
    made = estimator()
    assert holds(made.take_test(as_it_is(AXIS), 0.0), 1.0)
    told = after(made, production(replace(AXIS, preload=0.02)))
    assert holds(told, 0.02)
    assert "the last test was 0 days ago; friction has changed since" in told.reasons[-1]


def test_a_test_that_is_due_does_not_come_and_go_with_the_noise() -> None:
    made, due = estimator(), []
    made.take_test(as_it_is(AXIS), 0.0)
    for block in production(replace(AXIS, preload=0.75, friction=0.6316)):
        due.append("friction has changed" in str(after(made, [block]).reasons))
    assert sum(a != b for a, b in itertools.pairwise(due)) <= 1


def test_a_stop_of_unknown_length_ages_the_test(moves: list[FeatureBlock]) -> None:
    made, fresh = estimator(), estimator()
    first = made.take_test(as_it_is(HALF), 40.0)
    made.resume(30.0 * DAY_S)
    assert width(after(made, moves)) > width(first)
    made.resume(30.0 * DAY_S)
    assert width(after(made, moves)) == pytest.approx(width(after(fresh, moves)), abs=0.3)


def test_a_kept_state_keeps_the_test(worn_moves: list[FeatureBlock]) -> None:
    made, other = estimator(), estimator()
    made.take_test(as_it_is(HALF), 0.0)
    kept = json.loads(json.dumps(made.snapshot()))
    other.restore(kept)
    assert after(other, worn_moves) == after(made, worn_moves)
    plain = kept | {"test": kept["test"] | {"weights": [1.0]}}
    with pytest.raises(ValueError, match="damaged"):
        other.restore(plain)
    made.reset()
    assert made.snapshot()["test"] is None


def test_fewer_tests_than_wanted_leave_a_wide_answer() -> None:
    few, many = commissioned(AXIS, days=2), commissioned(AXIS, days=6)
    told = [estimator(each).take_test(as_it_is(AXIS), 40.0) for each in (few, many)]
    assert width(told[0]) > 1.5 * width(told[1])


def test_intervals_hold_what_drawn_axes_have_left() -> None:
    """Another law of the nut, another stated nut, a rest that drifts, other grease each day."""
    held, widths = [], []
    for number in range(40):
        random = np.random.default_rng([20261, number])
        axis, _ = drawn(random)
        healthy = [as_it_is(on_a_day(axis, random)) for _ in range(3)]
        machine = machine_of(axis, healthy, math.exp(0.15 * random.standard_normal()))
        for preload in (1.0, 0.7, 0.4, 0.2):
            seen = as_it_is(on_a_day(replace(axis, preload=preload), random))
            told = estimator(machine).take_test(seen, 40.0)
            held.append(holds(told, preload))
            widths += [width(told)] if axis.share >= 0.25 else []
    assert np.mean(held) > 0.93
    assert np.median(widths) < 3.0
