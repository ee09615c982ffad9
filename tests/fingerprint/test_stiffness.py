"""Stiffness from the stretch: exact on a spring, true on the simulated drive."""

import math

import numpy as np
import pytest

from edge_service.fingerprint.transmission.nut_preload import preload_from_stiffness
from edge_service.fingerprint.transmission.stiffness import (
    StiffnessFit,
    StiffnessPoint,
    backlash,
    fit_stiffness,
)
from edge_service.messages.samples import ANGLE, TABLE_POSITION, Floats, SampleFrame
from edge_service.models.machine import Machine, Quantity
from edge_service.models.screw.nut_law import nut_stiffness
from edge_service.regression.interval_estimate import around
from edge_service.regression.prepared_run import PreparationSettings, PreparedRun, prepare

from .conftest import FRESH, GUIDE_FORCE_N, production_setpoints

RATIO = 0.02 / (2.0 * math.pi)
PLACES_M = (0.1, 0.4, 0.7)
MASS = Quantity(value=20.0, tolerance=0.0)


def compliance(position_m: Floats) -> Floats:
    return 2.2e-8 + 1.5e-8 * position_m


def spring_axis(machine: Machine, seed: int, noise_m: float = 5e-8) -> SampleFrame:
    """Stretch from the formula on a production motion of the table."""
    setpoints = production_setpoints(machine, 30_000, seed)
    table, speed, acceleration = setpoints.T
    stretch = compliance(table) * (20.0 * acceleration + GUIDE_FORCE_N * np.sign(speed))
    stretch += 1e-4 * speed + 2e-5 * table + 3e-6
    noise = noise_m * np.random.default_rng(seed).standard_normal(len(table))
    return SampleFrame(
        np.arange(len(table)) / 1000.0,
        {ANGLE: (table + stretch) / RATIO, TABLE_POSITION: table + noise},
    )


def prepared(frame: SampleFrame) -> list[PreparedRun]:
    return list(prepare(frame, PreparationSettings(RATIO), required=()))


def assert_spring(found: StiffnessFit) -> None:
    for point in found.points:
        truth = compliance(np.array(point.position_m))
        assert point.stiffness.holds(1.0 / truth)
        assert point.locked_resonance.holds(1.0 / (2.0 * math.pi * math.sqrt(truth * 20.0)))
        assert point.lost_motion.holds(2.0 * GUIDE_FORCE_N * truth)


def test_a_spring_is_found_with_its_skew_and_its_lead_error(bench: Machine) -> None:
    found = fit_stiffness(prepared(spring_axis(bench, 1)), PLACES_M, MASS)
    assert_spring(found)
    assert all(point.stiffness.sigma < 0.01 * 5e7 for point in found.points)


def with_play(frame: SampleFrame, setpoints: Floats, width_m: float) -> SampleFrame:
    """The spring of `spring_axis` with a play: the flank is that of the force it carries."""
    _, speed, acceleration = setpoints.T
    carried_n = 20.0 * acceleration + GUIDE_FORCE_N * np.sign(speed)
    angle = frame.channels[ANGLE] + 0.5 * width_m * np.sign(carried_n) / RATIO
    return SampleFrame(frame.time_s, {**frame.channels, ANGLE: angle})


@pytest.mark.parametrize("mass", [MASS, None])
def test_play_that_turns_its_flank_is_no_compliance(bench: Machine, mass: Quantity | None) -> None:
    """The table brakes with 80 N against guides of 40 N: the flank turns in every deceleration."""
    setpoints = production_setpoints(bench, 30_000, 1)
    frame = with_play(spring_axis(bench, 1), setpoints, 8e-6)
    found = fit_stiffness(prepared(frame), PLACES_M, mass)
    assert found.play.value == pytest.approx(8e-6, rel=5e-3)
    for point in found.points:
        truth = compliance(np.array(point.position_m))
        resonance_hz = 1.0 / (2.0 * math.pi * math.sqrt(truth * 20.0))
        assert point.locked_resonance.value == pytest.approx(resonance_hz, rel=5e-3)
        lost_m = 2.0 * GUIDE_FORCE_N * truth + 8e-6
        assert point.lost_motion.value == pytest.approx(lost_m, rel=5e-3)
    if mass is not None:
        assert backlash(found.points[1], None, found.play) == found.play


def test_without_play_no_flank_turns(bench: Machine) -> None:
    for seed in range(8):
        found = fit_stiffness(prepared(spring_axis(bench, seed)), (0.1, 0.7), MASS)
        assert not found.play.determined


def test_without_the_mass_only_the_resonance_is_known(bench: Machine) -> None:
    found = fit_stiffness(prepared(spring_axis(bench, 1)), PLACES_M)
    for point in found.points:
        truth = compliance(np.array(point.position_m))
        assert not point.stiffness.determined
        assert "table_mass_kg" in point.stiffness.note
        assert point.locked_resonance.holds(1.0 / (2.0 * math.pi * math.sqrt(truth * 20.0)))


def point(lost_m: float, stiffness_n_per_m: float = 4e7) -> StiffnessPoint:
    return StiffnessPoint(
        0.4,
        around(stiffness_n_per_m, 1e5, "N/m", 1e6),
        around(200.0, 1.0, "Hz", 1e6),
        around(lost_m, 5e-8, "m", 1e6),
    )


def test_backlash_is_the_lost_motion_that_the_guides_do_not_explain() -> None:
    windup_m = 2.0 * 40.0 / 4e7
    found = backlash(point(windup_m + 5e-6), Quantity(value=40.0, tolerance=0.05))
    assert found.value == pytest.approx(5e-6, rel=1e-6)
    assert found.sigma == pytest.approx(math.hypot(5e-8, 0.05 * windup_m, windup_m / 400), rel=1e-6)
    none = backlash(point(windup_m), Quantity(value=40.0, tolerance=0.05))
    assert none.low == 0.0
    assert none.holds(0.0)
    unknown = backlash(point(windup_m + 5e-6), None)
    assert math.isnan(unknown.value)
    assert unknown.low == 0.0
    assert unknown.high == pytest.approx(windup_m + 5e-6 + 1.96 * 5e-8, rel=1e-3)


def worn_axis(percent: float) -> tuple[float, float, float]:
    """Series stiffness fresh and worn, and the fresh nut's, N/m."""
    rest = 1.5e-8
    fresh, worn = nut_stiffness(1.6e8, FRESH), nut_stiffness(1.6e8, percent)
    return 1.0 / (rest + 1.0 / fresh), 1.0 / (rest + 1.0 / worn), fresh


@pytest.mark.parametrize("percent", [1.0, 3.0, 5.0, FRESH])
def test_preload_follows_from_the_change_of_the_stiffness(percent: float) -> None:
    fresh, worn, nut = worn_axis(percent)
    now, then = (around(value, 1e-4 * value, "N/m", 1e6) for value in (worn, fresh))
    preload = Quantity(value=510.0, tolerance=0.0)
    found = preload_from_stiffness(now, then, preload, Quantity(value=nut, tolerance=0.01))
    truth = 510.0 * percent / FRESH
    assert found.value == pytest.approx(truth, rel=1e-3)
    assert found.holds(truth)
    assert found.sigma < 0.1 * 510.0
    ignorant = preload_from_stiffness(now, then, preload, None)
    assert math.isnan(ignorant.value)
    assert ignorant.low == 0.0
    assert ignorant.holds(truth)
    assert "nut_stiffness" in ignorant.note
