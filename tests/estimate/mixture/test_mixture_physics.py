"""Expectation of a hypothesis for a phase, against the equations solved another way."""

import math

import numpy as np
import pytest

from edge_service.estimate.mixture import physics, state
from edge_service.estimate.mixture.physics import stribeck, stroke_factor
from edge_service.estimate.mixture.state import Reading
from edge_service.messages.samples import Floats
from edge_service.models.screw.nut_law import nut_deflection

from .mixture_axis import CLEARANCE, FRESH, FRESH_N, Truth, deflection, idle, parts
from .mixture_filter import alone

MODEL, START, _ = parts()
PAIR = (MODEL.fresh_percent, MODEL.fresh_preload_n, MODEL.clearance_share)
LOADS_N = (-2000.0, -300.0, -1.0, 0.5, 60.0, 250.0, 1500.0)
PERCENTS = (0.05, 0.3, 1.0, 3.0, 7.0, 9.0)


def state_of(truth: Truth) -> Floats:
    x = np.zeros(state.STRETCH_STATES)
    x[state.PRELOAD] = math.log(truth.percent)
    x[state.NUT_FRICTION], x[state.BEARING_FRICTION] = truth.nut, truth.bearing
    x[state.GUIDE_FRICTION], x[state.VISCOUS] = truth.guide, truth.viscous
    x[state.GUIDE_VISCOUS], x[state.PAYLOAD] = truth.guide_viscous, truth.payload_kg
    x[state.TORQUE_OFFSET], x[state.LOOSENESS] = truth.offset_nm, truth.loose_m_per_n
    x[state.ENCODER_OFFSET], x[state.ENCODER_SLOPE] = truth.encoder_m, truth.encoder_slope
    x[state.CLOCK_SKEW], x[state.NUT_COMPLIANCE] = truth.skew_s, truth.nut_compliance
    x[state.COUPLING] = truth.coupling_m_per_n
    x[state.REVERSAL], x[state.TABLE_MASS] = truth.reversal, truth.mass_error
    x[state.MAP :] = truth.map_m
    return x


def another(seed: int) -> tuple[Truth, Reading]:
    """An axis that differs from the commissioned one in everything, and a phase."""
    rng = np.random.default_rng(seed)
    truth = Truth(
        percent=float(rng.uniform(0.5, 8.0)),
        nut=float(rng.normal(0.0, 0.1)),
        bearing=float(rng.normal(0.0, 0.1)),
        guide=float(rng.normal(0.0, 0.1)),
        viscous=float(rng.normal(0.0, 0.1)),
        guide_viscous=float(rng.normal(0.0, 0.1)),
        payload_kg=float(rng.normal(0.0, 5.0)),
        offset_nm=float(rng.normal(0.0, 0.05)),
        loose_m_per_n=float(rng.uniform(0.0, 3e-9)),
        coupling_m_per_n=float(rng.uniform(0.0, 3e-9)),
        encoder_m=float(rng.normal(0.0, 1e-5)),
        encoder_slope=float(rng.normal(0.0, 1e-5)),
        skew_s=float(rng.normal(0.0, 2e-6)),
        nut_compliance=float(rng.uniform(0.5e-8, 1.2e-8)),
        reversal=float(rng.uniform(-0.3, 0.3)),
        mass_error=float(rng.normal(0.0, 0.03)),
        map_m=rng.normal(0.0, 3e-8, 4),
    )
    return truth, idle(rng)


def torque(x: Floats, r: Reading) -> tuple[float, Floats]:
    slope = np.zeros(len(x))
    factor, slow_nm = stroke_factor(MODEL, r.table_m), stribeck(MODEL, r)
    return physics.expected_torque(MODEL, x, r, factor, slow_nm, slope), slope


def stretch(x: Floats, r: Reading) -> tuple[float, Floats, float]:
    slope = np.zeros(len(x))
    value, compliance = physics.expected_stretch(
        MODEL, x, r, stroke_factor(MODEL, r.table_m), slope
    )
    return value, slope, compliance


@pytest.mark.parametrize("seed", range(30))
def test_torque_and_stretch_are_those_of_the_equations(seed: int) -> None:
    truth, r = another(seed)
    x = state_of(truth)
    assert torque(x, r)[0] == pytest.approx(truth.torque(r), rel=1e-12)
    assert stretch(x, r)[0] == pytest.approx(truth.stretch(r), rel=1e-8, abs=1e-13)


@pytest.mark.parametrize("seed", range(20))
def test_slopes_of_the_torque_are_its_differences(seed: int) -> None:
    truth, r = another(seed)
    x = state_of(truth)
    value, slope = torque(x, r)
    for i in range(len(x)):
        step = np.zeros(len(x))
        step[i] = 1e-6
        slanted = (torque(x + step, r)[0] - torque(x - step, r)[0]) / 2e-6
        assert slope[i] == pytest.approx(slanted, rel=1e-6, abs=1e-9), i
    assert math.isfinite(value)


@pytest.mark.parametrize("seed", range(20))
def test_slopes_of_the_stretch_are_its_differences(seed: int) -> None:
    truth, r = another(seed)
    x = state_of(truth)
    scale = np.full(len(x), 1e-4)
    scale[[state.NUT_COMPLIANCE, state.LOOSENESS, state.COUPLING]] = 1e-13
    _, slope, _ = stretch(x, r)
    for i in range(1, len(x)):
        step = np.zeros(len(x))
        step[i] = scale[i]
        slanted = (stretch(x + step, r)[0] - stretch(x - step, r)[0]) / (2.0 * scale[i])
        assert slope[i] * scale[i] == pytest.approx(slanted * scale[i], rel=2e-5, abs=1e-15), i


@pytest.mark.parametrize("percent", PERCENTS)
@pytest.mark.parametrize("load_n", LOADS_N)
def test_the_nut_yields_as_two_contacts_in_balance(load_n: float, percent: float) -> None:
    y, by_force, by_percent = nut_deflection(load_n, percent, *PAIR)
    assert y == pytest.approx(deflection(load_n, percent), rel=1e-6, abs=1e-9)
    steps = (1e-3 * abs(load_n), 1e-4 * percent)
    slanted = [
        (deflection(load_n + steps[0], percent) - deflection(load_n - steps[0], percent))
        / steps[0],
        (deflection(load_n, percent + steps[1]) - deflection(load_n, percent - steps[1]))
        / steps[1],
    ]
    assert by_force == pytest.approx(0.5 * slanted[0], rel=2e-3)
    assert by_percent == pytest.approx(0.5 * slanted[1], rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("hanging_n", [0.0, 30.0, 600.0, -600.0])
def test_a_heavy_table_keeps_a_nut_without_preload_on_one_side(hanging_n: float) -> None:
    """Accelerating as gently as it does moves no play that its weight has closed."""
    process, bank, model = parts()[2], alone(parts()[1], 0.0), MODEL._replace(hanging_n=hanging_n)
    bank.mean[0, state.PRELOAD], bank.covariance[0] = math.log(0.02), 0.0
    n = bank.mean.shape[1]
    zeros = np.zeros((2, 2, n)), np.zeros(2), np.eye(2), np.zeros(n), np.zeros((3, 2))
    found = physics.Innovation(*zeros[0], *zeros[1:])
    r = idle(np.random.default_rng(1))._replace(acceleration_rad_s2=200.0, stretch_m=0.0)
    physics.innovate(bank, 0, model, process, r, physics.noise_of(model, r), True, found)
    assert (found.covariance[1, 1] > 0.8 * process.loose_m**2) == (abs(hanging_n) < 100.0)


@pytest.mark.parametrize("percent", [1.0, 3.5, 7.0])
def test_a_small_load_meets_the_cube_root_law(percent: float) -> None:
    """K_n over that of the fresh pair is (p / p0)^(1/3) (5.3.11)."""
    load_n = 1.0
    fresh, worn = (nut_deflection(load_n, p, *PAIR)[0] for p in (FRESH, percent))
    assert fresh == pytest.approx(load_n / (3.0 * FRESH_N), rel=1e-4)
    assert fresh / worn == pytest.approx(np.cbrt(percent / FRESH), rel=2e-3)


def test_without_preload_the_pair_crosses_its_clearance_before_it_bears() -> None:
    left = (0.02 / FRESH) ** (2.0 / 3.0)
    y, _, _ = nut_deflection(1e-3, 0.0, *PAIR)
    assert y == pytest.approx(CLEARANCE - left, abs=1e-3)
    heavy, _, _ = nut_deflection(FRESH_N, 0.0, *PAIR)
    assert heavy == pytest.approx(CLEARANCE - left + 1.0, rel=1e-3)  # a single Hertz contact
