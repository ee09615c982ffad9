"""The mixture estimator as a thing: snapshot, restore, reset, and numbers that are numbers."""

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

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.features import Phase
from edge_service.messages.stored import decoded, encoded

from .production import AXIS, machine, production, run


@pytest.mark.parametrize("case", ["drop", "payload"])
def test_a_restored_estimator_goes_on_bit_equal(case: str) -> None:
    blocks = production(case)
    half = len(blocks) // 2 + 5
    first = MixturePreloadEstimator(machine())
    run(blocks[:half], first)
    second = MixturePreloadEstimator(machine())
    second.restore(json.loads(json.dumps(first.snapshot(), allow_nan=False)))
    for mine, other in zip(run(blocks[half:], first), run(blocks[half:], second), strict=True):
        assert mine.model_dump_json() == other.model_dump_json()
    assert first.snapshot() == second.snapshot()


def test_a_snapshot_of_another_axis_is_refused_and_changes_nothing() -> None:
    two, one = (
        MixturePreloadEstimator(machine()),
        MixturePreloadEstimator(machine(one_encoder=True)),
    )
    run(production("healthy")[:100], two)
    run(production("healthy", one_encoder=True)[:100], one)
    before = one.snapshot()
    with pytest.raises(ValueError, match="another axis"):
        one.restore(two.snapshot())
    assert one.snapshot() == before


@pytest.mark.parametrize(
    "spoil",
    [
        lambda document: document["bank"]["arrays"].update(
            mean=document["bank"]["arrays"]["force"]
        ),
        lambda document: document["bank"]["arrays"].update(
            covariance=not_finite(document, "covariance")
        ),
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
    with pytest.raises(ValueError, match="commissioned"):
        MixturePreloadEstimator(AXIS.nominal())
