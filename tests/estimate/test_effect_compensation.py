"""A known effect is taken off the phases, so that it no longer biases anything."""

import math

import numpy as np
import pytest

from edge_service.estimate.commissioning.identification import commissioned
from edge_service.estimate.effect_compensation import EffectCompensation
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.features import FeatureBlock, Phase
from edge_service.models.effects.registry import parse_effect
from edge_service.models.machine import EffectConfig, Machine, Quantity

from ..bench.estimator.axis import OwnAxis, downsampled
from ..bench.estimator.scores import Recorded, follow, score

AXIS = OwnAxis(1)
RATIO = 0.02 / (2.0 * math.pi)


def with_effects(machine: Machine, *texts: str) -> Machine:
    effects = []
    for text in texts:
        active = parse_effect(text)
        parameters = {name: Quantity(value=value) for name, value in active.values.items()}
        effects.append(EffectConfig(name=active.effect.name, parameters=parameters))
    return machine.model_copy(update={"effects": tuple(effects)})


def known(*texts: str) -> EffectCompensation:
    return EffectCompensation.of_machine(with_effects(AXIS.nominal(), *texts))


def cruise(speed_rad_s: float, table_m: float = 0.4, acceleration: float = 0.0) -> Phase:
    return Phase(0.1, 0.5, acceleration, speed_rad_s, table_m / RATIO, table_m)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_a_rough_place_is_taken_off_where_it_is(direction: float) -> None:
    rough = known("position_friction:excess_nm=0.1,centre_m=0.4,width_m=0.2")
    at_it = rough.compensated(cruise(5.0 * direction), direction, 1.0)
    assert at_it.torque_nm == pytest.approx(0.5 - direction * 0.1, abs=1e-3)
    beside = rough.compensated(cruise(5.0 * direction, 0.0), direction, 1.0)
    assert beside.torque_nm == pytest.approx(0.5, abs=1e-3)


def test_a_ripple_is_averaged_over_the_phase() -> None:
    """Over whole periods nothing is left of it; over a quarter of one, 2 / pi of its height."""
    ripple = known("torque_ripple:amplitude_nm=0.1,order=4,phase_rad=0")
    period = Phase(0.1, 0.5, 0.0, 2.0 * math.pi / 4.0 / 0.1 * 17.0 / 16.0, 0.0, 0.0)
    assert ripple.compensated(period, 1.0, 1.0).torque_nm == pytest.approx(0.5, abs=2e-3)
    quarter = Phase(0.1, 0.5, 0.0, 2.0 * math.pi / 16.0 / 0.1, math.pi / 8.0, 0.0)
    assert abs(ripple.compensated(quarter, 1.0, 1.0).torque_nm - 0.5) == pytest.approx(
        0.1 * 2.0 * math.sqrt(2.0) / math.pi, rel=0.02
    )


def test_the_flank_of_a_play_is_the_one_that_carries() -> None:
    """Forwards none, backwards the width; a hard braking table lies on the other flank."""
    play = known("backlash:width_m=1e-5")
    force_n = play.baseline.table_coulomb_nm / RATIO
    mass_kg = play.baseline.table_inertia_kg_m2 / RATIO**2
    braking = -2.0 * (force_n + 50.0) / mass_kg / RATIO
    for speed, acceleration, shift in (
        (5.0, 0.0, 0.0),
        (-5.0, 0.0, 1e-5),
        (5.0, braking, 1e-5),
        (-5.0, -braking, 0.0),
    ):
        phase = cruise(speed, acceleration=acceleration)
        compensated = play.compensated(phase, math.copysign(1.0, speed), 1.0)
        if force_n < 15.0 and acceleration == 0.0:
            assert math.isnan(compensated.angle_rad)
        else:
            assert RATIO * (compensated.angle_rad - phase.angle_rad) == pytest.approx(
                shift, abs=1e-12
            )


def test_what_the_estimate_follows_itself_is_left() -> None:
    mixed = known("drag_error:change_nm=0.1", "warmup:excess_nm=0.1", "viscous_error")
    assert mixed.left == ("drag_error", "warmup")
    assert [one.effect.name for one in mixed.used] == ["viscous_error"]


def blocks(effect: str, seconds: float, seed: int) -> list[FeatureBlock]:
    percent = np.full(round(1000 * seconds), AXIS.fresh_percent)
    return downsampled(AXIS.frames("production", percent, seed, (effect,)), AXIS.nominal())


@pytest.mark.parametrize(
    "effect",
    [
        "compliance:level_m_per_n=3e-9",
        "torque_ripple:amplitude_nm=0.1,order=4",
        "torque_gain_error:excess_share=0.1",
    ],
)
def test_an_effect_that_comes_after_commissioning_is_known(effect: str) -> None:
    recorded = blocks(effect, 40.0, 7)
    truth = Recorded(recorded, np.array([0.0, 40.0]), np.full(2, AXIS.fresh_percent))
    estimator = MixturePreloadEstimator(with_effects(AXIS.commissioned(), effect))
    found = score(follow(estimator, truth).since(100))
    assert found.answered == found.moments
    assert found.mae < 0.7
    assert found.coverage > 0.85


def test_commissioning_sees_the_axis_without_what_is_known() -> None:
    effect = "viscous_error:change_nm_s_per_rad=2e-3"
    percent = np.full(60_000, AXIS.fresh_percent)
    frames = list(AXIS.frames("production", percent, 3, (effect,)))
    plain = commissioned([downsampled(frames, AXIS.nominal())], AXIS.nominal())
    nominal = with_effects(AXIS.nominal(), effect)
    compensated = commissioned([downsampled(frames, nominal)], nominal)
    lower = plain.model.viscous_nm_s_per_rad.value - compensated.model.viscous_nm_s_per_rad.value
    assert lower == pytest.approx(2e-3, rel=0.02)


def test_what_is_left_is_said() -> None:
    estimator = MixturePreloadEstimator(with_effects(AXIS.commissioned(), "drag_error"))
    for block in blocks("drag_error:change_nm=0.0", 10.0, 9):
        estimator.update(block)
    said = estimator.estimate()
    assert said.status is EstimateStatus.ESTIMATED
    assert said.reasons[0].startswith("effects_left: drag_error")
