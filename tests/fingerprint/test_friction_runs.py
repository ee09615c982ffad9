"""Changes between friction tests, on points whose truth is a formula."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats

from edge_service.fingerprint.friction.cruises import FrictionPoint
from edge_service.fingerprint.friction.curve import (
    friction_parts,
    friction_tests,
    measure_friction_runs,
)

SPEEDS_RPM = (15, 60, 300, 1200, 3000)
MIDDLE_RPM = 300
COULOMB_NM, VISCOUS, ERROR_NM = 0.4, 5e-3, 1e-3
COLD_NM, WARM_S, RUN_S = 0.08, 600.0, 130.0
STATIONS_NM = (0.02, 0.0, -0.03)
"""Factor on the friction at each place of the stroke."""
Extra = Callable[[float], float]


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
