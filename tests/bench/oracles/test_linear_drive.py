import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from scipy import signal
from scipy.integrate import solve_ivp

from edge_service.messages import channels
from edge_service.models.plant.two_mass import (
    STATE_SIZE,
    Load,
    Plant,
    advance_plant,
    axial_compliance,
)
from tests.bench.oracles.linear_drive import OneMassDrive, TwoMassDrive, mass_chain

RATIO = 0.02 / (2.0 * math.pi)
ONE = OneMassDrive(inertia_kg_m2=1.5e-3, viscous_nm_s_per_rad=5e-3, ratio_m_per_rad=RATIO)
TWO = TwoMassDrive(
    motor_inertia_kg_m2=1.3e-3,
    table_inertia_kg_m2=2e-4,
    stiffness_nm_per_rad=350.0,
    damping_nm_s_per_rad=0.02,
    motor_viscous_nm_s_per_rad=4e-3,
    table_viscous_nm_s_per_rad=1e-3,
    ratio_m_per_rad=RATIO,
)
FREQUENCIES_HZ = np.geomspace(0.1, 2000.0, 60)
PERIOD_S = 1e-3
S = Polynomial([0.0, 1.0])


def response(drive: OneMassDrive | TwoMassDrive, output: str, source: str) -> np.ndarray:
    model = drive.state_space()
    row, column = model.outputs.index(output), model.inputs.index(source)
    return model.frequency_response(FREQUENCIES_HZ)[:, row, column]


def equations_of_motion(drive: TwoMassDrive, state: np.ndarray, u: float, f: float) -> np.ndarray:
    """Newton's law for [theta_1, w_1, theta_2, w_2], written out once more."""
    th1, w1, th2, w2 = state
    between = drive.stiffness_nm_per_rad * (th1 - th2) + drive.damping_nm_s_per_rad * (w1 - w2)
    on_motor = u - between - drive.motor_viscous_nm_s_per_rad * w1
    on_table = RATIO * f + between - drive.table_viscous_nm_s_per_rad * w2
    return np.array(
        [w1, on_motor / drive.motor_inertia_kg_m2, w2, on_table / drive.table_inertia_kg_m2]
    )


def test_one_mass_transfer_function_is_the_state_space() -> None:
    printed = ONE.transfer_function().frequency_response(FREQUENCIES_HZ)
    direct = response(ONE, channels.ANGLE, channels.TORQUE)
    np.testing.assert_allclose(printed, direct, rtol=1e-10)


def test_one_mass_z_transform_has_the_closed_form_coefficients() -> None:
    """(5.3.17) put right: step invariance of 1 / (J s^2 + D s) by partial fractions."""
    inertia, damping = ONE.inertia_kg_m2, ONE.viscous_nm_s_per_rad
    for period_s in (1e-3, 0.1):
        p = math.exp(-damping * period_s / inertia)
        b1 = (period_s - inertia * (1.0 - p) / damping) / damping
        b2 = (inertia * (1.0 - p) / damping - p * period_s) / damping
        z = ONE.z_transform(period_s)
        np.testing.assert_allclose(z.numerator, [0.0, b1, b2], rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(z.denominator, [1.0, -(1.0 + p), p], rtol=1e-12)


def test_one_mass_settles_at_the_viscous_speed_and_integrates_the_angle() -> None:
    model = ONE.state_space()
    assert ONE.transfer_function().static_gain() == math.inf
    assert ONE.z_transform(PERIOD_S).static_gain() == math.inf
    end = model.sampled(0.01).respond(np.tile([0.5, 20.0], (1000, 1)))[-1]
    expected_rad_s = (0.5 + RATIO * 20.0) / ONE.viscous_nm_s_per_rad
    assert end[1] == pytest.approx(expected_rad_s, rel=1e-9)
    assert end[3] == pytest.approx(RATIO * expected_rad_s, rel=1e-9)


def test_two_mass_transfer_function_is_the_state_space() -> None:
    """(5.3.19) put right against (5.3.21) put right."""
    printed = RATIO * TWO.transfer_function().frequency_response(FREQUENCIES_HZ)
    direct = response(TWO, channels.TABLE_POSITION, channels.TORQUE)
    np.testing.assert_allclose(printed, direct, rtol=1e-9)


@settings(deadline=None)
@given(
    state=st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4),
    u=st.floats(-10.0, 10.0),
    f=st.floats(-1e3, 1e3),
)
def test_two_mass_state_space_is_newtons_law(state: list[float], u: float, f: float) -> None:
    model = TWO.state_space()
    ours = np.array([*state[2:], *state[:2]])  # (5.3.21) has the table first
    rate = model.state_matrix @ ours + model.input_matrix @ np.array([u, f])
    expected = equations_of_motion(TWO, np.array(state), u, f)
    np.testing.assert_allclose([*rate[2:], *rate[:2]], expected, rtol=1e-9, atol=1e-6)


def test_two_mass_response_at_samples_is_the_dense_solution() -> None:
    """Inputs: a torque step and a later push on the table; also (5.3.20) as a recursion."""
    count, push_at = 60, 20
    inputs = np.zeros((count, 2))
    inputs[:, 0] = 1.5
    inputs[push_at:, 1] = -120.0
    outputs = TWO.state_space().sampled(PERIOD_S).respond(inputs)
    dense, start = [np.zeros((4, 1))], np.zeros(4)
    for begin, end in ((0, push_at), (push_at, count - 1)):
        solution = solve_ivp(
            lambda _, x, f=inputs[begin, 1]: equations_of_motion(TWO, x, 1.5, f),
            (begin * PERIOD_S, end * PERIOD_S),
            start,
            method="DOP853",
            t_eval=np.arange(begin + 1, end + 1) * PERIOD_S,
            rtol=1e-11,
            atol=1e-13,
        )
        dense.append(solution.y)
        start = solution.y[:, -1]
    angle, speed, table_rad, table_rad_s = np.hstack(dense)
    expected = np.column_stack([angle, speed, RATIO * table_rad, RATIO * table_rad_s])
    np.testing.assert_allclose(outputs, expected, rtol=1e-7, atol=1e-9)

    z = TWO.z_transform(PERIOD_S)
    by_torque = TWO.state_space().sampled(PERIOD_S).respond(inputs * [1.0, 0.0])[:, 2]
    recursion = RATIO * signal.lfilter(z.numerator, z.denominator, inputs[:, 0])
    np.testing.assert_allclose(recursion, by_torque, rtol=1e-6, atol=1e-12)


def test_two_mass_z_transform_has_one_integrator_and_no_coefficient_to_spare() -> None:
    z = TWO.z_transform(PERIOD_S)
    assert len(z.denominator) == 5
    assert np.min(np.abs(z.poles() - 1.0)) == pytest.approx(0.0, abs=1e-9)
    assert np.all(np.abs(z.numerator[1:]) > 1e-3 * np.max(np.abs(z.numerator)))
    sampled_poles = np.sort_complex(np.exp(TWO.transfer_function().poles() * PERIOD_S))
    np.testing.assert_allclose(np.sort_complex(z.poles()), sampled_poles, atol=1e-8)


def test_stiff_spring_gives_the_one_mass_drive() -> None:
    low = FREQUENCIES_HZ < 500.0
    stiff = replace(TWO, stiffness_nm_per_rad=1e9)
    lumped = OneMassDrive(1.5e-3, 5e-3, RATIO)
    for output in (channels.ANGLE, channels.TABLE_SPEED):
        for source in (channels.TORQUE, channels.EXTERNAL_FORCE):
            ours, limit = (response(drive, output, source)[low] for drive in (stiff, lumped))
            np.testing.assert_allclose(ours, limit, rtol=1e-4)


@settings(deadline=None)
@given(stiffness=st.floats(10.0, 1e4), factor=st.floats(1.01, 10.0))
def test_stiffer_means_faster(stiffness: float, factor: float) -> None:
    free = replace(TWO, damping_nm_s_per_rad=0.0, motor_viscous_nm_s_per_rad=0.0)
    free = replace(free, table_viscous_nm_s_per_rad=0.0, stiffness_nm_per_rad=stiffness)
    (resonance,) = free.state_space().resonances()
    assert 2.0 * math.pi * resonance.frequency_hz == pytest.approx(free.resonance_rad_s, rel=1e-6)
    assert resonance.damping_ratio == pytest.approx(0.0, abs=1e-6)
    assert free.antiresonance_rad_s < free.resonance_rad_s
    stiffer = replace(free, stiffness_nm_per_rad=factor * stiffness)
    assert stiffer.resonance_rad_s == pytest.approx(math.sqrt(factor) * free.resonance_rad_s)


def test_angle_over_torque_has_its_zero_at_the_antiresonance() -> None:
    free = replace(TWO, damping_nm_s_per_rad=0.0, table_viscous_nm_s_per_rad=0.0)
    zero_hz = np.array([free.antiresonance_rad_s / (2.0 * math.pi)])
    gain = np.abs(free.state_space().frequency_response(zero_hz)[0, 0, 0])
    assert gain < 1e-9 * np.abs(free.state_space().frequency_response(0.5 * zero_hz)[0, 0, 0])


def test_torque_at_the_table_and_force_at_the_motor_are_reciprocal() -> None:
    """Maxwell: x per torque equals angle per force, for any damping."""
    np.testing.assert_allclose(
        response(TWO, channels.TABLE_POSITION, channels.TORQUE),
        response(TWO, channels.ANGLE, channels.EXTERNAL_FORCE),
        rtol=1e-9,
    )


def test_without_friction_energy_and_momentum_stay() -> None:
    free = replace(
        TWO,
        damping_nm_s_per_rad=0.0,
        motor_viscous_nm_s_per_rad=0.0,
        table_viscous_nm_s_per_rad=0.0,
    )
    start = np.array([0.0, 0.0, 5e-3, 2.0])  # twisted, the motor turning
    outputs = free.state_space().sampled(1.3e-4).respond(np.zeros((5000, 2)), start)
    angle, speed, table_rad, table_rad_s = (outputs / [1.0, 1.0, RATIO, RATIO]).T
    motor, table = free.motor_inertia_kg_m2, free.table_inertia_kg_m2
    energy_j = 0.5 * (motor * speed**2 + table * table_rad_s**2)
    energy_j += 0.5 * free.stiffness_nm_per_rad * (angle - table_rad) ** 2
    np.testing.assert_allclose(energy_j, energy_j[0], rtol=1e-8)
    np.testing.assert_allclose(motor * speed + table * table_rad_s, motor * 2.0, rtol=1e-8)


def test_two_mass_drive_of_the_plant_moves_as_the_plant_does(plant: Plant) -> None:
    smooth = plant._replace(guide_force_n=0.0, bearing_drag_nm=0.0)
    drive, count = TwoMassDrive.of_plant(smooth, 0.4, 6.8), 100
    inputs = np.tile([1.0, -50.0], (count, 1))
    outputs = drive.state_space().sampled(PERIOD_S).respond(inputs)
    state = np.zeros(STATE_SIZE)
    load = Load(1.0, -50.0, 0.0, axial_compliance(smooth, 0.4, 6.8))
    for k in range(count):
        travel = np.array([state[0], state[1], state[2], state[3]]) / [RATIO, RATIO, 1.0, 1.0]
        np.testing.assert_allclose(travel, outputs[k], rtol=2e-3, atol=1e-6)
        advance_plant(smooth, state, load, PERIOD_S, 256)


def test_two_masses_are_a_chain_of_two() -> None:
    drive = replace(TWO, ratio_m_per_rad=1.0)
    chain = mass_chain(
        np.array([drive.motor_inertia_kg_m2, drive.table_inertia_kg_m2]),
        np.array([drive.stiffness_nm_per_rad]),
        np.array([drive.damping_nm_s_per_rad]),
        np.array([drive.motor_viscous_nm_s_per_rad, drive.table_viscous_nm_s_per_rad]),
    )
    ours = chain.frequency_response(FREQUENCIES_HZ)[:, [0, 2, 1, 3], :]
    theirs = drive.state_space().frequency_response(FREQUENCIES_HZ)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


def last_over_first(*, masses: list[float], springs: list[float]) -> np.ndarray:
    chain = mass_chain(np.array(masses), np.array(springs))
    return chain.frequency_response(FREQUENCIES_HZ)[:, len(masses) - 1, 0]


def at_frequencies(numerator: float, denominator: Polynomial) -> np.ndarray:
    return numerator / denominator(2j * np.pi * FREQUENCIES_HZ)


def test_chain_of_one_and_two_is_as_printed() -> None:
    m1, m2, k1 = 90.0, 20.0, 3e7
    np.testing.assert_allclose(
        last_over_first(masses=[m1], springs=[]), at_frequencies(1.0, m1 * S**2)
    )
    printed = m1 * m2 * S**4 + (m1 * k1 + m2 * k1) * S**2  # (5.3.7)
    np.testing.assert_allclose(
        last_over_first(masses=[m1, m2], springs=[k1]), at_frequencies(k1, printed), rtol=1e-9
    )


def test_chain_of_three_is_the_determinant_of_the_print_put_right() -> None:
    m1, m2, m3, k1, k2 = 70.0, 15.0, 20.0, 8e7, 3e7
    first_minor = (m2 * S**2 + k1 + k2) * (m3 * S**2 + k2) - k2**2
    second_minor = -k1 * (m3 * S**2 + k2)
    determinant = (m1 * S**2 + k1) * first_minor + k1 * second_minor
    a1, a2 = m1 * m2 * m3, m1 * m2 * k2 + m1 * m3 * (k1 + k2) + m2 * m3 * k1
    a3 = k1 * k2 * (m1 + m2 + m3)
    np.testing.assert_allclose(determinant.coef, [0.0, 0.0, a3, 0.0, a2, 0.0, a1])
    ours = last_over_first(masses=[m1, m2, m3], springs=[k1, k2])
    np.testing.assert_allclose(ours, at_frequencies(k1 * k2, determinant), rtol=1e-8)


@settings(deadline=None)
@given(count=st.integers(2, 8), mass=st.floats(0.1, 100.0), spring=st.floats(1e3, 1e9))
def test_even_chain_has_the_known_resonances(count: int, mass: float, spring: float) -> None:
    """Free chain of equal masses: w_j = 2 sqrt(k / m) sin(j pi / 2 n), j = 1 ... n - 1."""
    chain = mass_chain(np.full(count, mass), np.full(count - 1, spring))
    found = [2.0 * math.pi * mode.frequency_hz for mode in chain.resonances()]
    order = np.arange(1, count)
    expected = 2.0 * math.sqrt(spring / mass) * np.sin(order * math.pi / (2 * count))
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("masses", "springs", "word"),
    [
        ([], [], "masses_kg: expected shape"),
        ([1.0, 0.0], [1.0], "masses_kg: expected every mass"),
        ([1.0, 1.0], [], "springs_n_per_m: expected shape"),
        ([1.0, 1.0], [-1.0], "springs_n_per_m: expected finite"),
        ([1.0, math.nan], [1.0], "masses_kg: expected finite"),
    ],
)
def test_impossible_chains_are_refused(
    masses: list[float], springs: list[float], word: str
) -> None:
    with pytest.raises(ValueError, match=f"^{word}[^\n]*$"):
        mass_chain(np.array(masses), np.array(springs))


def test_impossible_drives_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^inertia_kg_m2 must"):
        replace(ONE, inertia_kg_m2=0.0)
    with pytest.raises(ValueError, match=r"^stiffness_nm_per_rad must"):
        replace(TWO, stiffness_nm_per_rad=-1.0)
    with pytest.raises(ValueError, match=r"^damping_nm_s_per_rad must"):
        replace(TWO, damping_nm_s_per_rad=math.nan)
