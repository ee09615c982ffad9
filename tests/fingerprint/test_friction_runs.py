"""Friction points and curves whose truth is a formula; friction from test to test."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy import stats

from edge_service.fingerprint.friction.cruises import FrictionPoint, friction_points
from edge_service.fingerprint.friction.curve import (
    fit_friction,
    friction_parts,
    friction_tests,
    measure_friction_runs,
)
from edge_service.messages.samples import ANGLE, TEMPERATURE, TORQUE, Floats, SampleFrame
from edge_service.models.screw.friction import exponential_friction
from edge_service.regression.prepared_run import PreparationSettings, prepare

SPEEDS_RPM = (15, 60, 300, 1200, 3000)
MIDDLE_RPM = 300
COULOMB_NM, VISCOUS, ERROR_NM = 0.4, 5e-3, 1e-3
COLD_NM, WARM_S, RUN_S = 0.08, 600.0, 130.0
STATIONS_NM = (0.02, 0.0, -0.03)
"""Factor on the friction at each place of the stroke."""
Extra = Callable[[float], float]
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
NOISE_NM = 1e-3


def run(start_s: float, seed: int, extra: Extra, stations: int = 3) -> list[FrictionPoint]:
    """A friction test: Coulomb, viscous, a part of the place and a part of the time."""
    random = np.random.default_rng(seed)
    points = []
    steps = [(rpm, k, way) for rpm in SPEEDS_RPM for k in range(stations) for way in (1.0, -1.0)]
    for number, (rpm, k, way) in enumerate(steps):
        time_s, harder_nm = start_s + RUN_S * number / len(steps), STATIONS_NM[k]
        speed = way * rpm * 2.0 * math.pi / 60.0
        torque = way * (COULOMB_NM + harder_nm + extra(time_s)) + VISCOUS * speed
        torque += ERROR_NM * random.standard_normal()
        points.append(FrictionPoint(time_s, speed, torque, ERROR_NM))
    return points


def warming(time_s: float) -> float:
    return COLD_NM * math.exp(-time_s / WARM_S)


def test_the_change_is_that_of_the_exponential_law() -> None:
    starts_s = (0.0, 430.0, 860.0, 1290.0, 1720.0)
    recordings = {f"{k:02}.csv": run(s, k, warming) for k, s in enumerate(starts_s, start=1)}
    figures, curves = measure_friction_runs(recordings)
    share = -math.expm1(-starts_s[-1] / WARM_S)
    for k, rpm in enumerate(SPEEDS_RPM):
        middle_s = RUN_S * (k + 0.5) / len(SPEEDS_RPM)
        found = figures[f"change_at_{rpm}_rpm_nm"]
        assert found.value == pytest.approx(-share * warming(middle_s), abs=4.0 * ERROR_NM / 6**0.5)
        assert found.high < 0.0
    assert next(iter(figures)) == f"change_at_{MIDDLE_RPM}_rpm_nm"
    assert [curve.name for curve in curves] == sorted(recordings)
    levels = [figures[f"run_{k}_level_{MIDDLE_RPM}_rpm_nm"].value for k in range(1, 6)]
    assert levels == sorted(levels, reverse=True)
    plain_nm = COULOMB_NM + np.mean([STATIONS_NM]) + VISCOUS * curves[0].x
    cold_nm = curves[0].y - plain_nm
    assert cold_nm == pytest.approx([COLD_NM] * 5, abs=0.2 * COLD_NM)


@pytest.mark.slow
def test_the_interval_holds_the_change_as_often_as_it_says() -> None:
    trials, held = 200, 0
    for seed in range(trials):
        recordings = {
            "a": run(0.0, 2 * seed, lambda _: 0.0),
            "b": run(500.0, 2 * seed + 1, lambda _: -0.05),
        }
        figures, _ = measure_friction_runs(recordings)
        held += figures[f"change_at_{MIDDLE_RPM}_rpm_nm"].holds(-0.05)
    assert held >= stats.binom.ppf(0.001, trials, 0.95)


def test_one_clock_orders_the_tests_and_else_their_names() -> None:
    late, early = run(900.0, 1, warming), run(100.0, 2, warming)
    again = run(100.5, 3, warming)
    assert [test.name for test in friction_tests({"a": late, "b": early})] == ["b", "a"]
    assert [test.name for test in friction_tests({"b": again, "a": early})] == ["a", "b"]
    assert [test.name for test in friction_tests({"b": early, "a": again})] == ["a", "b"]


def test_a_recording_at_few_speeds_or_in_one_direction_is_no_friction_test() -> None:
    whole = run(0.0, 1, warming)
    slow = [point for point in whole if abs(point.speed_rad_s) < 40.0]
    forward = [point for point in whole if point.forward]
    assert friction_tests({"slow": slow, "forward": forward, "none": []}) == []
    with pytest.raises(ValueError, match="1 recordings hold a friction test"):
        measure_friction_runs({"a": whole, "slow": slow})


def test_the_parts_make_up_the_curve() -> None:
    rising = friction_parts(run(0.0, 1, lambda _: 0.0))
    assert set(rising.parts_nm(np.ones(1))) == {"Coulomb", "viscous"}
    speed = np.array([-30.0, -1.0, 1.0, 30.0])
    points = run(0.0, 1, lambda _: 0.0, stations=2)
    stribeck = [
        FrictionPoint(
            point.time_s,
            point.speed_rad_s,
            point.torque_nm
            + math.copysign(0.2 * math.exp(-((point.speed_rad_s / 4.0) ** 2)), point.speed_rad_s),
            ERROR_NM,
        )
        for point in points
    ]
    parts = friction_parts(stribeck).parts_nm(speed)
    level_nm = COULOMB_NM + 0.5 * (STATIONS_NM[0] + STATIONS_NM[1])
    assert parts["Coulomb"] == pytest.approx(level_nm * np.sign(speed), rel=0.1)
    assert parts["viscous"] == pytest.approx(VISCOUS * speed, rel=0.05)
    low_nm = 0.2 * math.exp(-1.0 / 16.0)
    assert parts["Stribeck"] == pytest.approx([0.0, -low_nm, low_nm, 0.0], abs=0.04)


def exponential_points(seed: int, speed_rad_s: Floats = BOTH_WAYS) -> list[FrictionPoint]:
    torque_nm = exponential_friction(speed_rad_s, 0.3, 0.42, 4.0, 5e-3) - 0.02
    noise = NOISE_NM * np.random.default_rng(seed).standard_normal(len(torque_nm))
    return [
        FrictionPoint(0.0, float(v), float(u), NOISE_NM)
        for v, u in zip(speed_rad_s, torque_nm + noise, strict=True)
    ]


def test_the_exponential_form_is_found_within_its_intervals() -> None:
    found = fit_friction(exponential_points(1))
    for name, truth in EXPONENTIAL.items():
        assert found.parameters[name].holds(truth), name
        assert found.parameters[name].sigma < 0.1 * abs(truth)
    truth_nm = exponential_friction(SPEEDS_RAD_S, 0.3, 0.42, 4.0, 5e-3) - 0.02
    np.testing.assert_allclose(found.torque_nm(SPEEDS_RAD_S), truth_nm, atol=3.0 * NOISE_NM)


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
