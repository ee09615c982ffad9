"""Axes that are not as commissioned from the first sample on, or after a stop that nobody saw."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import TORQUE, Floats

from ... import foreign_plant as plant
from ...bench.estimator.axis import downsampled
from ...bench.estimator.plants.foreign import commissioned_machine, recorded
from ...cases.case_file import Edit
from .production import AXIS, FRESH, answers_to, held, machine, misled, numbers, run

LEARNT_S, SHORT = 20.0, 400


def assert_held(said: Sequence[PreloadEstimate], percent: float) -> None:
    """Numbers come, they hold the truth, and once learnt they are near it."""
    answers = numbers(said)
    assert len(answers) > 0.9 * len(said)
    assert held(answers, percent) > 0.9
    assert np.abs(answers[answers[:, 0] > LEARNT_S, 1] - percent).mean() < 0.7


FOLLOWED = ("inertia_error:change_kg_m2=1e-4", "torque_gain_error:excess_share=0.1")
NOT_FOLLOWED = (
    "backlash:width_m=4e-6",
    "backlash:width_m=1e-5",
    "encoder_eccentricity:amplitude_rad=3e-4",
)


@pytest.mark.parametrize("effect", FOLLOWED)
def test_what_is_there_from_the_first_sample_is_no_loss(effect: str) -> None:
    assert_held(run(production(FRESH, 7, (effect,))[:SHORT]), FRESH)


@pytest.mark.parametrize("effect", NOT_FOLLOWED)
def test_what_the_model_does_not_know_is_not_taken_for_a_loss(effect: str) -> None:
    """Either no number, or one whose interval holds the truth."""
    answers = numbers(run(production(FRESH, 7, (effect,))[:SHORT]))
    assert misled(answers[answers[:, 0] > LEARNT_S], FRESH) < 0.05


@pytest.mark.parametrize("share", [0.5, 0.25])
def test_preload_that_was_lost_before_the_first_sample_is_reported(share: float) -> None:
    percent = share * FRESH
    said = run(production(percent, 7))
    assert_held(said, percent)
    assert said[-1].fault_probability["preload_loss"] > 0.9


def test_a_healthy_axis_has_none_of_it() -> None:
    last = run(production(FRESH, 7))[-1]
    for fault in ("looseness", "payload", "lubrication"):
        assert last.fault_probability[fault] < 0.05


def test_a_screw_that_is_warm_at_the_start_is_no_loss() -> None:
    """Grown unevenly, with friction 30 % down: on the plant that shares no code with the model."""
    warm = plant.Warmup(start=1.0)
    case = plant.axis_case(seed=405, axis_seed=5, duration_s=40.0, events=(warm,))
    said = run(recorded(case).blocks, MixturePreloadEstimator(commissioned_machine(5)))
    assert_held(said, plant.Machine().preload_percent)


@pytest.mark.parametrize(
    ("factor", "effects"), [(1.3, ()), (0.7, ()), (1.0, ("saturation:limit_nm=0.9",))]
)
def test_a_wrong_torque_does_not_mislead(factor: float, effects: tuple[str, ...]) -> None:
    """Not for long: the beginning may, until the second witness has spoken."""
    answers = numbers(answers_to(Edit(scale={TORQUE: factor}), effects=effects))
    assert misled(answers[answers[:, 0] > LEARNT_S], FRESH) < 0.05


WORN = 5.0
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
    estimator = MixturePreloadEstimator(machine(one_encoder))
    run(before, estimator)
    estimator.resume(NIGHT_S)
    assert estimator.estimate().preload_percent is None
    return numbers(run(after, estimator))


@pytest.mark.parametrize("one_encoder", [False, True])
def test_preload_does_not_come_back_over_night_on_a_cold_axis(one_encoder: bool) -> None:
    """Friction is a fifth higher; on torque alone that is 3.6 points of preload."""
    worn = production(WORN, 6, one_encoder=one_encoder)
    answers = after_a_night(worn, production(WORN, 7, COLD, one_encoder), one_encoder)
    assert held(answers, WORN) > 0.9
    assert answers[:, 1].max() < 0.5 * (WORN + FRESH)


@pytest.mark.parametrize("percent", [FRESH, 1.0])
def test_another_screw_and_an_unseen_loss_are_found(percent: float) -> None:
    answers = after_a_night(production(WORN, 6), production(percent, 7))
    late = answers[answers[:, 0] > 45.0]
    assert held(late, percent) > 0.9
