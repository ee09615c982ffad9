"""Changes beside the preload: each is told with its probability, and not read as a loss."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from edge_service.estimate.fused import FusedPreloadEstimator
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.samples import SampleFrame
from edge_service.studies.estimator_axis import OwnAxis, downsampled

AXIS = OwnAxis(1)
HEALTHY_S, CHANGED_S = 20.0, 40.0


@cache
def told(effect: str | None) -> PreloadEstimate:
    """Production, healthy at first; then the axis has the effect."""
    machine = AXIS.commissioned()
    frames: list[SampleFrame] = []
    for seconds, seed, effects in (
        (HEALTHY_S, 7, ()),
        (CHANGED_S, 8, (effect,) if effect else ()),
    ):
        percent = np.full(round(1000 * seconds), AXIS.fresh_percent)
        begin_s = frames[-1].time_s[-1] + 0.001 if frames else 0.0
        frames += [
            replace(frame, time_s=frame.time_s + begin_s)
            for frame in AXIS.frames("production", percent, seed, effects)
        ]
    estimator = FusedPreloadEstimator(machine)
    for block in downsampled(frames, machine):
        estimator.update(block)
    return estimator.estimate()


@pytest.mark.parametrize(
    ("effect", "fault"),
    [
        ("drag_error:change_nm=0.12", "lubrication"),
        ("inertia_error:change_kg_m2=1e-4", "payload"),
    ],
)
def test_each_change_is_told_by_its_name(effect: str, fault: str) -> None:
    said = told(effect)
    assert said.fault_probability[fault] > 0.9
    assert said.fault_probability["preload_loss"] < 0.5
    assert said.low is not None
    assert said.high is not None
    assert said.low <= AXIS.fresh_percent <= said.high


def test_a_healthy_axis_has_none() -> None:
    said = told(None)
    assert set(said.fault_probability) == {
        "preload_loss",
        "lubrication",
        "process_force",
        "payload",
        "looseness",
    }
    assert max(said.fault_probability.values()) < 0.1


def test_one_encoder_knows_fewer() -> None:
    axis = OwnAxis(1, one_encoder=True)
    percent = np.full(10_000, axis.fresh_percent)
    estimator = FusedPreloadEstimator(axis.commissioned())
    for block in downsampled(axis.frames("production", percent, 3), axis.nominal()):
        estimator.update(block)
    assert set(estimator.estimate().fault_probability) == {
        "preload_loss",
        "lubrication",
        "process_force",
    }
