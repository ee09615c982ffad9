"""Changes beside the preload: each is named with its probability, and not read as a loss."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import PreloadEstimate

from ...bench.estimator.axis import OwnAxis, downsampled

AXIS = OwnAxis(1)
HEALTHY_S, STOPPED_S, CHANGED_S = 40.0, 5.0, 60.0
PAYLOAD = "10 kg on the table"


@cache
def answer_to(effect: str | None) -> PreloadEstimate:
    """Production, healthy at first; then, after a stop, the axis has the effect."""
    machine = AXIS.commissioned()
    percent = np.full(round(1000 * CHANGED_S), AXIS.fresh_percent)
    frames = list(AXIS.frames("production", percent[: round(1000 * HEALTHY_S)], 7))
    effects = (effect,) if effect and effect != PAYLOAD else ()
    loads = {"added_mass_kg": np.full(len(percent), 10.0)} if effect == PAYLOAD else {}
    frames += [
        replace(frame, time_s=frame.time_s + HEALTHY_S + STOPPED_S)
        for frame in AXIS.frames("production", percent, 8, effects, **loads)
    ]
    estimator = MixturePreloadEstimator(machine)
    for block in downsampled(frames, machine):
        estimator.update(block)
    return estimator.estimate()


@pytest.mark.parametrize(
    ("effect", "fault"),
    [
        ("drag_error:change_nm=0.12", "lubrication"),
        ("compliance:level_m_per_n=4e-9", "looseness"),
        (PAYLOAD, "payload"),
    ],
)
def test_each_change_is_named_by_its_name(effect: str, fault: str) -> None:
    said = answer_to(effect)
    assert said.fault_probability[fault] > 0.9
    assert said.fault_probability["preload_loss"] < 0.5
    assert said.low is not None
    assert said.high is not None
    assert said.low <= AXIS.fresh_percent <= said.high


@pytest.mark.parametrize(
    "effect", ["quadratic_friction", "torque_ripple:amplitude_nm=0.08", "encoder_eccentricity"]
)
def test_what_no_preload_explains_is_not_read_as_one(effect: str) -> None:
    said = answer_to(effect)
    if said.low is None or said.high is None:
        assert said.reasons[0].partition(":")[0] in ("model_mismatch", "process_force")
    else:
        assert said.low <= AXIS.fresh_percent <= said.high
