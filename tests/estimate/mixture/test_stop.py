"""Knowledge that a stop which nobody saw leaves."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import Floats

from ...bench.estimator.axis import OwnAxis, downsampled

AXIS = OwnAxis(1)
FRESH, WORN = AXIS.fresh_percent, 5.0
NIGHT_S = 8 * 3600.0
COLD = ("drag_error:change_nm=0.07",)


def production(
    percent: float, seed: int, effects: Sequence[str] = (), one_encoder: bool = False
) -> list[FeatureBlock]:
    axis = replace(AXIS, one_encoder=one_encoder)
    frames = axis.frames("production", np.full(60_000, percent), seed, effects)
    return downsampled(frames, axis.nominal())


def after_a_night(
    before: Sequence[FeatureBlock], after: Sequence[FeatureBlock], one_encoder: bool = False
) -> Floats:
    """Time, preload, low, high, (n, 4), of an estimator that knew the axis the day before."""
    estimator = MixturePreloadEstimator(replace(AXIS, one_encoder=one_encoder).commissioned())
    for block in before:
        estimator.update(block)
    estimator.resume(NIGHT_S)
    assert estimator.estimate().preload_percent is None
    rows = []
    for block in after:
        estimator.update(block)
        answer = estimator.estimate()
        rows.append((answer.time_s, answer.preload_percent, answer.low, answer.high))
    return np.array([row for row in rows if row[1] is not None], dtype=np.float64)


@pytest.mark.parametrize("one_encoder", [False, True])
def test_preload_does_not_come_back_over_night_on_a_cold_axis(one_encoder: bool) -> None:
    """Friction is a fifth higher; on torque alone that is 3.6 points of preload."""
    worn = production(WORN, 6, one_encoder=one_encoder)
    answers = after_a_night(worn, production(WORN, 7, COLD, one_encoder), one_encoder)
    assert np.mean((answers[:, 2] <= WORN) & (answers[:, 3] >= WORN)) > 0.9
    assert answers[:, 1].max() < 0.5 * (WORN + FRESH)


@pytest.mark.parametrize("percent", [FRESH, 1.0])
def test_another_screw_and_an_unseen_loss_are_found(percent: float) -> None:
    answers = after_a_night(production(WORN, 6), production(percent, 7))
    late = answers[answers[:, 0] > 45.0]
    assert np.mean((late[:, 2] <= percent) & (late[:, 3] >= percent)) > 0.9
