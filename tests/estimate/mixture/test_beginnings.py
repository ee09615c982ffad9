"""Axes that are not as commissioned from the first sample on."""

from collections.abc import Sequence

import numpy as np
import pytest

from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.models.machine import Machine

from ... import foreign_plant as plant
from ...bench.estimator.axis import downsampled
from ...bench.estimator.plants.foreign import commissioned_machine, recorded
from ...bench.estimator.plants.spoiled import CASES, spoiled
from .production import AXIS, FRESH, held, machine, misled, numbers

LEARNT_S = 20.0


def blocks_with(effect: str, percent: float = FRESH) -> list[FeatureBlock]:
    """40 s of production with an effect from the first sample on."""
    frames = AXIS.frames("production", np.full(40_000, percent), 7, (effect,))
    return downsampled(frames, AXIS.nominal())


def estimates(of: Machine, blocks: Sequence[FeatureBlock]) -> list[PreloadEstimate]:
    estimator, said = MixturePreloadEstimator(of), []
    for block in blocks:
        estimator.update(block)
        said.append(estimator.estimate())
    return said


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
    assert_held(estimates(machine(), blocks_with(effect)), FRESH)


@pytest.mark.parametrize("effect", NOT_FOLLOWED)
def test_what_the_model_does_not_know_is_not_taken_for_a_loss(effect: str) -> None:
    """Either no number, or one whose interval holds the truth."""
    answers = numbers(estimates(machine(), blocks_with(effect)))
    assert misled(answers[answers[:, 0] > LEARNT_S], FRESH) < 0.05


@pytest.mark.parametrize("share", [0.5, 0.25])
def test_preload_that_was_lost_before_the_first_sample_is_reported(share: float) -> None:
    percent = share * FRESH
    frames = AXIS.frames("production", np.full(40_000, percent), 7)
    said = estimates(machine(), downsampled(frames, AXIS.nominal()))
    assert_held(said, percent)
    assert said[-1].fault_probability["preload_loss"] > 0.9


def test_a_healthy_axis_has_none_of_it() -> None:
    frames = AXIS.frames("production", np.full(40_000, FRESH), 7)
    last = estimates(machine(), downsampled(frames, AXIS.nominal()))[-1]
    for fault in ("looseness", "payload", "lubrication"):
        assert last.fault_probability[fault] < 0.05


def test_a_screw_that_is_warm_at_the_start_is_no_loss() -> None:
    """Grown unevenly, with friction 30 % down: on the plant that shares no code with the model."""
    warm = plant.Warmup(start=1.0)
    case = plant.axis_case(seed=405, axis_seed=5, duration_s=40.0, events=(warm,))
    said = estimates(commissioned_machine(5), recorded(case).blocks)
    assert_held(said, plant.Machine().preload_percent)


WRONG = ("torque constant +30 %", "torque constant -30 %", "saturated drive")


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_torque_does_not_mislead(name: str) -> None:
    """Not for long: the beginning may, until the second witness has spoken."""
    case = next(case for case in CASES if case.name == name)
    answers = numbers(estimates(machine(), spoiled(case, AXIS, machine(), 60.0).blocks))
    assert misled(answers[answers[:, 0] > LEARNT_S], FRESH) < 0.05
