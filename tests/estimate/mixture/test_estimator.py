"""The mixture estimator as a thing: snapshot, restore, reset, numbers; short intervals gathered."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from edge_service.downsample.statistics import absent_block
from edge_service.estimate.interface import UnsuitableMachineError, make_estimator
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.estimate.mixture.gathering import WHOLE_S, gathered
from edge_service.messages.features import Fault, FeatureBlock, Phase
from edge_service.messages.stored import decoded, encoded

from .production import AXIS, machine, production, run


def test_a_snapshot_of_another_axis_is_refused_and_changes_nothing() -> None:
    two, one = (MixturePreloadEstimator(machine(one_encoder=each)) for each in (False, True))
    run(production("healthy")[:100], two)
    run(production("healthy", one_encoder=True)[:100], one)
    before = one.snapshot()
    with pytest.raises(ValueError, match="another axis"):
        one.restore(two.snapshot())
    assert one.snapshot() == before


@pytest.mark.parametrize(
    "spoil",
    [
        lambda d: d["bank"]["arrays"].update(mean=d["bank"]["arrays"]["force"]),
        lambda d: d["bank"]["arrays"].update(covariance=not_finite(d, "covariance")),
        lambda document: document["bank"]["layout"].update(PRELOAD=1),
        lambda document: document.update(schema="mixture-preload/3"),
        lambda document: document.pop("bank"),
        lambda document: document.update(last_s="long"),
    ],
)
def test_a_damaged_snapshot_is_refused_and_changes_nothing(
    spoil: Callable[[dict[str, Any]], object],
) -> None:
    estimator = MixturePreloadEstimator(machine())
    run(production("healthy")[:60], estimator)
    before = estimator.snapshot()
    document = json.loads(json.dumps(begun(False)))
    spoil(document)
    with pytest.raises((ValueError, KeyError)):
        estimator.restore(document)
    assert estimator.snapshot() == before


def not_finite(document: dict[str, Any], name: str) -> str:
    values = decoded(document["bank"]["arrays"][name], np.dtype(np.float64))
    return str(encoded(np.full_like(values, np.nan)))


@cache
def begun(one_encoder: bool) -> dict[str, Any]:
    """Snapshot after 40 good intervals."""
    estimator = MixturePreloadEstimator(machine(one_encoder))
    run(production("healthy", one_encoder=one_encoder)[:40], estimator)
    return estimator.snapshot()


ANY = st.floats(allow_nan=True, allow_infinity=True)
PHASE = st.builds(
    Phase,
    steady_s=st.floats(1e-4, 1.0),
    torque_nm=ANY,
    acceleration_rad_s2=ANY,
    speed_rad_s=ANY,
    angle_rad=ANY,
    table_m=ANY,
)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(PHASE, st.sampled_from([-1.0, 1.0]), ANY), min_size=1, max_size=6),
    st.booleans(),
)
@example([(Phase(0.1, 0.1, 0.0, 5.0, 3.0, 7.63e306), 1.0, math.nan)], False)
@example([(Phase(0.1, 0.1, 0.0, 5.0, 1e300, 0.3), 1.0, math.nan)] * 2, False)
@example([(Phase(0.1, 0.1, 0.0, 5.0, 3.0, 0.3), 1.0, 1e300)], False)
def test_garbage_never_yields_a_number_that_is_none(
    garbage: list[tuple[Phase, float, float]], one_encoder: bool
) -> None:
    """Between good intervals: every number of every estimate is finite, also long after."""
    good = production("healthy", one_encoder=one_encoder)
    estimator = MixturePreloadEstimator(machine(one_encoder))
    estimator.restore(begun(one_encoder))
    dirty = [
        replace(
            good[40],
            time_s=good[40].time_s + 0.1 * number,
            cruising=phase,
            accelerating=Phase(),
            braking=Phase(),
            steady_direction=direction,
            external_force_n=force,
        )
        for number, (phase, direction, force) in enumerate(garbage)
    ]
    for estimate in run([*dirty, *good[47:55]], estimator):
        figures = (estimate.preload_percent, estimate.low, estimate.high, estimate.nis)
        assert all(value is None or math.isfinite(value) for value in figures)
        if estimate.preload_percent is not None:
            assert 0.0 <= estimate.low <= estimate.preload_percent <= estimate.high  # type: ignore[operator]
    living = estimator._bank.alive > 0
    assert np.isfinite(estimator._bank.mean[living]).all()
    assert np.isfinite(estimator._bank.covariance[living]).all()


def test_an_uncommissioned_machine_is_refused() -> None:
    with pytest.raises(UnsuitableMachineError, match="commission"):
        make_estimator("mixture", AXIS.nominal())


def block(number: int, duration_s: float, torque_nm: float, direction: float = 1.0) -> FeatureBlock:
    """The interval of that number, cruising for all of its time."""
    empty = absent_block(number, duration_s, Fault.NONE)
    cruising = Phase(duration_s, torque_nm, 0.0, direction * 10.0, number * 0.1, math.nan)
    return replace(empty, steady_direction=direction, cruising=cruising)


def test_a_mean_over_short_intervals_is_that_of_all_their_time() -> None:
    waiting = None
    for k in range(5):
        done, waiting = gathered(waiting, block(k, 0.02, float(k)))
        assert len(done) == (k == 4)
    assert waiting is None
    assert (done[0].duration_s, done[0].phases[1].steady_s) == pytest.approx((WHOLE_S, 0.1))
    assert done[0].phases[1].torque_nm == pytest.approx((0 + 1 + 2 + 3 + 4) / 5)


@pytest.mark.parametrize("after", [block(1, 0.02, 5.0, -1.0), block(9, 0.02, 5.0)])
def test_another_direction_and_a_gap_end_what_waits(after: FeatureBlock) -> None:
    _, waiting = gathered(None, block(0, 0.02, 1.0))
    (first,), waiting = gathered(waiting, after)
    assert first.phases[1].torque_nm == 1.0
    assert waiting is not None
