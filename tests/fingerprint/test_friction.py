"""Friction points from cruises, and curves through points whose truth is a formula."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from edge_service.fingerprint.friction.cruises import FrictionPoint, friction_points
from edge_service.fingerprint.friction.curve import fit_friction
from edge_service.messages.samples import ANGLE, TEMPERATURE, TORQUE, Floats, SampleFrame
from edge_service.models.screw.friction import exponential_friction
from edge_service.regression.prepared_run import PreparationSettings, prepare

RATIO = 0.02 / (2.0 * math.pi)
TABLE_5_1_RPM = (15, 30, 60, 120, 150, 300, 600, 1200, 1500, 3000)
SPEEDS_RAD_S = np.array(TABLE_5_1_RPM) * 2.0 * math.pi / 60.0
BOTH_WAYS = np.concatenate((SPEEDS_RAD_S, -SPEEDS_RAD_S))
EXPONENTIAL = {
    "coulomb_nm": 0.3,
    "stribeck_excess_nm": 0.12,
    "stribeck_speed_rad_s": 4.0,
    "viscous_nm_s_per_rad": 5e-3,
    "offset_nm": -0.02,
}
ERROR_NM = 1e-3


def exponential_points(seed: int, speed_rad_s: Floats = BOTH_WAYS) -> list[FrictionPoint]:
    torque_nm = exponential_friction(speed_rad_s, 0.3, 0.42, 4.0, 5e-3) - 0.02
    noise = ERROR_NM * np.random.default_rng(seed).standard_normal(len(torque_nm))
    return [
        FrictionPoint(0.0, float(v), float(u), ERROR_NM)
        for v, u in zip(speed_rad_s, torque_nm + noise, strict=True)
    ]


def test_the_exponential_form_is_found_within_its_intervals() -> None:
    found = fit_friction(exponential_points(1))
    for name, truth in EXPONENTIAL.items():
        assert found.parameters[name].holds(truth), name
        assert found.parameters[name].sigma < 0.1 * abs(truth)
    truth_nm = exponential_friction(SPEEDS_RAD_S, 0.3, 0.42, 4.0, 5e-3) - 0.02
    np.testing.assert_allclose(found.torque_nm(SPEEDS_RAD_S), truth_nm, atol=3.0 * ERROR_NM)


def test_one_direction_cannot_tell_the_offset() -> None:
    points = exponential_points(4)
    found = fit_friction([point for point in points if point.forward]).parameters
    assert not found["offset_nm"].determined
    assert found["coulomb_nm"].holds(0.3 - 0.02)
    backward = fit_friction([point for point in points if not point.forward]).parameters
    assert backward["coulomb_nm"].holds(0.3 + 0.02)


def cruises(frame: SampleFrame, **changes: float) -> Sequence[FrictionPoint]:
    settings = PreparationSettings(RATIO, **changes)  # type: ignore[arg-type]
    return list(friction_points(prepare(frame, settings)))


def test_ripple_of_the_revolution_leaves_whole_revolutions_alone() -> None:
    time_s = np.arange(6000) / 1000.0
    angle = 7.0 * time_s
    torque = 0.4 + 0.1 * np.sin(angle)
    channels = {ANGLE: angle, TORQUE: torque, TEMPERATURE: np.full(6000, 31.0)}
    (point,) = cruises(SampleFrame(time_s, channels))
    assert point.speed_rad_s == pytest.approx(7.0, rel=1e-6)
    assert point.torque_nm == pytest.approx(0.4, abs=1e-3)
    assert point.forward


def test_the_standard_error_counts_independent_samples() -> None:
    means, errors = [], []
    time_s = np.arange(1500) / 1000.0
    for seed in range(60):
        torque = 0.4 + 0.05 * np.random.default_rng(seed).standard_normal(1500)
        (point,) = cruises(SampleFrame(time_s, {ANGLE: 3.0 * time_s, TORQUE: torque}))
        means.append(point.torque_nm)
        errors.append(point.standard_error_nm)
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.25)
