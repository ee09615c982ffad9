"""Consistency of motion that is written down by formula: what counts, and what must not."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from edge_service.health.consistency import (
    COMPARED,
    LEARNED,
    STRETCH_S,
    ConsistencyWatch,
    Disagreement,
)
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock, Phase
from edge_service.messages.health import ConsistencyState

RATIO = 0.02 / (2.0 * math.pi)
TORQUE_NOISE_NM, TABLE_NOISE_M = 3e-3, 5e-8
HEALTHY = {
    "inertia": 1.5e-3,
    "drag": 0.15,
    "viscous": 5e-3,
    "offset": 0.0,
    "compliance": 2e-9,
    "growth": 0.0,
    "play": 0.0,
    "bend": 0.0,
    "wind_up": 1e-6,
}
READY_S = (LEARNED + COMPARED + 1) * STRETCH_S
"""By then the limits are known."""


def motion(seed: int, from_s: float, seconds: float, **changed: float) -> Iterator[FeatureBlock]:
    """Intervals of an axis whose torque and stretch follow J a + b v + F s and c m a."""
    random = np.random.default_rng(seed)
    axis = HEALTHY | changed
    for k in range(round(seconds / 0.1)):
        direction = float(random.choice([-1.0, 1.0]))
        speed = direction * float(np.exp(random.uniform(np.log(2.0), np.log(250.0))))
        place_m = float(random.uniform(0.0, 0.8))
        push = float(random.uniform(100.0, 900.0))
        names = ("accelerating", "cruising", "braking")
        phases = {
            name: _phase(axis, direction, speed, way * direction * push, place_m, random)
            for name, way in zip(names, (1.0, 0.0, -1.0), strict=True)
        }
        values = dict.fromkeys(FEATURE_FIELDS, 0.0) | {
            "time_s": from_s + 0.1 * (k + 1),
            "duration_s": 0.1,
            "fault": Fault.NONE,
            "steady_direction": direction,
        }
        yield FeatureBlock(**(values | phases))  # type: ignore[arg-type]


def _phase(
    axis: dict[str, float],
    direction: float,
    speed: float,
    acceleration: float,
    place_m: float,
    random: np.random.Generator,
) -> Phase:
    torque = axis["inertia"] * acceleration + axis["viscous"] * speed + axis["drag"] * direction
    stretch_m = axis["compliance"] * acceleration + axis["growth"] * place_m
    stretch_m += axis["bend"] * place_m**2 - axis["wind_up"] * direction
    stretch_m += axis["play"] if direction < 0.0 else 0.0
    return Phase(
        1.0 / 30.0,
        torque + axis["offset"] + TORQUE_NOISE_NM * random.standard_normal(),
        acceleration,
        speed,
        place_m / RATIO,
        place_m + stretch_m + TABLE_NOISE_M * random.standard_normal(),
    )


def told(watch: ConsistencyWatch, blocks: Iterator[FeatureBlock]) -> list[Disagreement]:
    return [change for block in blocks if (change := watch.add(block))]


def learned(seed: int) -> ConsistencyWatch:
    watch = ConsistencyWatch(RATIO)
    assert told(watch, motion(seed, 0.0, READY_S)) == []
    return watch


@pytest.mark.parametrize(
    ("changed", "channel"), [({"offset": 0.1}, "torque_nm"), ({"play": 3e-6}, "transmission_m")]
)
def test_a_change_is_seen_within_four_stretches_and_dated(changed, channel):
    watch = learned(1)
    (change,) = told(watch, motion(2, READY_S, 4 * STRETCH_S, **changed))
    assert (change.disagrees, change.channel) == (True, channel)
    assert READY_S - STRETCH_S < change.since_s < READY_S + STRETCH_S
    assert watch.shown().state is ConsistencyState.DISAGREES


@pytest.mark.parametrize(
    "changed",
    [
        {"drag": 0.03},
        {"drag": 0.1, "viscous": 3e-3},
        {"growth": 3e-5},
        {"compliance": 4e-9},
        {"inertia": 1.9e-3},
        {"bend": 1e-5},
        {"wind_up": 1.2e-6},
        {"play": 2e-7},
    ],
)
def test_what_the_estimator_follows_and_what_does_not_matter_is_no_disagreement(changed):
    watch = learned(1)
    assert told(watch, motion(2, READY_S, 10 * STRETCH_S, **changed)) == []
    assert watch.shown().state is ConsistencyState.AGREES


@pytest.mark.parametrize("seed", range(5))
def test_an_hour_of_healthy_motion_is_silent(seed):
    watch = ConsistencyWatch(RATIO)
    assert told(watch, motion(seed, 0.0, 3600.0 / 5)) == []


def test_it_agrees_again_when_the_cause_is_gone():
    watch = learned(1)
    told(watch, motion(2, READY_S, 5 * STRETCH_S, offset=0.1))
    (change,) = told(watch, motion(3, READY_S + 5 * STRETCH_S, 5 * STRETCH_S))
    assert not change.disagrees
    assert watch.shown().state is ConsistencyState.AGREES


def test_one_stretch_alone_does_not_count():
    watch = learned(1)
    assert told(watch, motion(2, READY_S, STRETCH_S, offset=0.1)) == []
    assert told(watch, motion(3, READY_S + STRETCH_S, 10 * STRETCH_S)) == []


def test_before_it_has_learned_it_says_so():
    watch = ConsistencyWatch(RATIO)
    assert told(watch, motion(1, 0.0, 5 * STRETCH_S)) == []
    assert watch.shown().state is ConsistencyState.LEARNING


def test_a_restart_goes_on_from_what_was_learned():
    watch, other = learned(1), ConsistencyWatch(RATIO)
    other.restore(watch.snapshot())
    changed = list(motion(2, READY_S, 4 * STRETCH_S, offset=0.1))
    (change,), (same,) = told(other, iter(changed)), told(watch, iter(changed))
    assert (change.channel, change.disagrees) == (same.channel, same.disagrees)
    assert change.since_s == pytest.approx(same.since_s, abs=STRETCH_S)
    with pytest.raises(ValueError, match="another version"):
        broken = replace(watch.snapshot()["torque_nm"], cross=np.ones(1))
        other.restore(watch.snapshot() | {"torque_nm": broken})


def test_one_encoder_watches_the_torque_alone():
    watch = ConsistencyWatch(None)
    assert told(watch, motion(1, 0.0, READY_S)) == []
    (change,) = told(watch, motion(2, READY_S, 4 * STRETCH_S, offset=0.1))
    assert change.channel == "torque_nm"
