"""Axes that are not as commissioned from the first sample on."""

import math
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from scipy.integrate import quad

from edge_service.estimate.fused import FusedPreloadEstimator
from edge_service.estimate.fused_model import FusedSettings, fused_model, start_of
from edge_service.estimate.fused_physics import flank_variance, mean_turn
from edge_service.estimate.fused_state import Reading
from edge_service.messages.estimate import PreloadEstimate
from edge_service.messages.features import FeatureBlock
from edge_service.models.machine import Machine
from edge_service.studies.estimator_axis import OwnAxis, downsampled
from edge_service.studies.estimator_foreign import (
    CHECKOUT_TESTS,
    commissioned_machine,
    foreign_plant,
    recorded,
)
from edge_service.studies.estimator_hostile import CASES, spoiled
from edge_service.studies.estimator_scores import follow, score

AXIS = OwnAxis(1)
FRESH = AXIS.fresh_percent
LEARNT_S = 20.0


@cache
def machine() -> Machine:
    return AXIS.commissioned()


def blocks_with(effect: str, percent: float = FRESH) -> list[FeatureBlock]:
    """40 s of production with an effect from the first sample on."""
    frames = AXIS.frames("production", np.full(40_000, percent), 7, (effect,))
    return downsampled(frames, AXIS.nominal())


def estimates(machine: Machine, blocks: Sequence[FeatureBlock]) -> list[PreloadEstimate]:
    estimator, said = FusedPreloadEstimator(machine), []
    for block in blocks:
        estimator.update(block)
        said.append(estimator.estimate())
    return said


def assert_held(said: Sequence[PreloadEstimate], percent: float) -> None:
    """Numbers come, they hold the truth, and once learnt they are near it."""
    told = [(e.time_s, e.preload_percent, e.low, e.high) for e in said]
    rows = np.array([row for row in told if row[1] is not None], dtype=np.float64)
    assert len(rows) > 0.9 * len(said)
    assert np.mean((rows[:, 2] <= percent) & (rows[:, 3] >= percent)) > 0.9
    assert np.abs(rows[rows[:, 0] > LEARNT_S, 1] - percent).mean() < 0.4


BEGINNINGS = (
    "backlash:width_m=4e-6",
    "backlash:width_m=1e-5",
    "encoder_eccentricity:amplitude_rad=3e-4",
    "inertia_error:change_kg_m2=1e-4",
    "torque_gain_error:excess_share=0.1",
)


@pytest.mark.parametrize("effect", BEGINNINGS)
def test_what_is_there_from_the_first_sample_is_no_loss(effect: str) -> None:
    assert_held(estimates(machine(), blocks_with(effect)), FRESH)


def test_half_of_the_preload_with_a_play_is_told_and_the_play_as_well() -> None:
    percent = 0.5 * FRESH
    said = estimates(machine(), blocks_with("backlash:width_m=1e-5", percent))
    assert_held(said, percent)
    assert said[-1].fault_probability["backlash"] > 0.9
    assert said[-1].fault_probability["preload_loss"] > 0.9


def test_a_healthy_axis_has_none_of_it() -> None:
    frames = AXIS.frames("production", np.full(40_000, FRESH), 7)
    last = estimates(machine(), downsampled(frames, AXIS.nominal()))[-1]
    for fault in ("backlash", "payload", "torque_constant"):
        assert last.fault_probability[fault] < 0.05


def test_a_screw_that_is_warm_at_the_start_is_no_loss() -> None:
    """Grown unevenly, with friction 30 % down: on the plant that shares no code with the model."""
    plant = foreign_plant(CHECKOUT_TESTS)
    warm = plant.Warmup(start=1.0)
    case = plant.axis_case(seed=405, axis_seed=5, duration_s=40.0, events=(warm,))
    said = estimates(commissioned_machine(CHECKOUT_TESTS, 5), recorded(CHECKOUT_TESTS, case).blocks)
    assert_held(said, plant.Machine().preload_percent)


@pytest.mark.parametrize(
    "name", ["torque constant +30 %", "torque constant -30 %", "saturated drive"]
)
def test_a_wrong_torque_never_misleads_not_even_in_the_first_second(name: str) -> None:
    case = next(case for case in CASES if case.name == name)
    track = follow(FusedPreloadEstimator(machine()), spoiled(case, AXIS, machine(), 30.0))
    assert score(track).misleading == 0.0


def test_the_beginnings_are_a_distribution() -> None:
    """Probabilities add up, covariances are covariances."""
    settings = FusedSettings()
    start = start_of(machine(), fused_model(machine(), settings), settings)
    assert sum(share for share, _ in start.beginnings) == pytest.approx(1.0)
    for _, covariance in start.beginnings:
        scale = np.sqrt(np.diag(covariance))
        there = scale > 0.0
        unit = covariance[np.ix_(there, there)] / np.outer(scale[there], scale[there])
        np.testing.assert_allclose(unit, unit.T, atol=1e-12)
        assert np.linalg.eigvalsh(unit).min() > -1e-9


def reading(direction: float = 1.0) -> Reading:
    return Reading(
        steady_s=0.08,
        direction=direction,
        torque_nm=0.5,
        acceleration_rad_s2=-400.0,
        speed_rad_s=35.0,
        table_m=0.3,
        stretch_m=0.0,
    )


def test_the_mean_turn_is_the_integral_over_the_phase() -> None:
    model, r = fused_model(machine(), FusedSettings()), reading()
    begin_s, end_s = -0.5 * r.steady_s, 0.5 * r.steady_s

    def turned(t: float) -> float:
        way = r.speed_rad_s * t + 0.5 * r.acceleration_rad_s2 * (t * t - r.steady_s**2 / 12.0)
        return r.table_m / model.ratio_m_per_rad + way

    cosine = quad(lambda t: math.cos(turned(t)), begin_s, end_s)[0] / r.steady_s
    sine = quad(lambda t: math.sin(turned(t)), begin_s, end_s)[0] / r.steady_s
    assert mean_turn(model, r) == pytest.approx((cosine, sine), abs=0.01)


def test_where_a_table_lies_in_its_play_is_doubted_only_where_it_may_have_crossed_it() -> None:
    play_m, sigma_m = 4e-6, 1e-6
    second_moment = play_m**2 + sigma_m**2

    def doubted(direction: float, back: float) -> float:
        return flank_variance(reading(direction), play_m, sigma_m**2, back)

    assert doubted(1.0, 0.0) == doubted(-1.0, 1.0) == 0.0  # the screw pulls its table along
    assert doubted(1.0, 0.5) == pytest.approx(0.25 * second_moment)  # nothing presses
    assert doubted(1.0, 1.0) == doubted(-1.0, 0.0)  # the table pushes
    assert 0.0 < doubted(1.0, 1.0) < doubted(1.0, 0.5)
