import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.models.plant.two_mass import STATE_SIZE as PLANT_SIZE
from edge_service.models.plant.two_mass import Load, Plant, advance_plant, axial_compliance
from tests.bench.oracles.linear_drive import TwoMassDrive

from .component_drive import STATE_SIZE, TABLE_SPEED, ComponentDrive, ComponentRun, simulate
from .printed_friction import DirectionalFriction, Friction

RATIO = 0.02 / (2.0 * math.pi)
GUIDE = Friction(
    coulomb_n=60.0,
    breakaway_n=90.0,
    stribeck_speed_m_s=5e-3,
    coulomb_speed_m_s=1e-4,
    viscous_n_s_per_m=200.0,
)
SMOOTH = Friction(0.0, 0.0, 1.0, 1.0)
DRIVE = ComponentDrive(
    motor_inertia_kg_m2=1.14e-3,
    shaft_inertia_kg_m2=1.3e-4,
    shaft_stiffness_nm_per_rad=350.0,
    shaft_damping_nm_s_per_rad=0.02,
    ratio_m_per_rad=RATIO,
    platform_mass_kg=20.0,
    friction=GUIDE,
)


def held(drive: ComponentDrive, torque_nm: float, force_n: float, end_s: float) -> ComponentRun:
    time_s = np.linspace(0.0, end_s, 201)
    return simulate(drive, time_s, np.full(201, torque_nm), np.full(201, force_n))


def energy_j(drive: ComponentDrive, run: ComponentRun) -> np.ndarray:
    twist_rad = run.motor_angle_rad - run.table_position_m / drive.ratio_m_per_rad
    return 0.5 * (
        drive.input_inertia_kg_m2 * run.motor_speed_rad_s**2
        + drive.moved_mass_kg * run.table_speed_m_s**2
        + drive.shaft_stiffness_nm_per_rad * twist_rad**2
    )


def test_without_friction_it_is_the_two_mass_drive() -> None:
    """Against the exact samples of (5.3.21), with a pulse of torque and a push on the table."""
    drive = replace(DRIVE, friction=SMOOTH)
    linear = TwoMassDrive(
        motor_inertia_kg_m2=1.14e-3 + 0.65e-4,
        table_inertia_kg_m2=20.0 * RATIO**2 + 0.65e-4,
        stiffness_nm_per_rad=350.0,
        damping_nm_s_per_rad=0.02,
        motor_viscous_nm_s_per_rad=0.0,
        table_viscous_nm_s_per_rad=0.0,
        ratio_m_per_rad=RATIO,
    )
    time_s = np.arange(101) * 1e-3
    inputs = np.zeros((101, 2))
    inputs[10:14, 0] = 8.0
    inputs[50:, 1] = -200.0
    run = simulate(drive, time_s, inputs[:, 0], inputs[:, 1])
    expected = linear.state_space().sampled(1e-3).respond(inputs)
    ours = (run.motor_angle_rad, run.motor_speed_rad_s, run.table_position_m, run.table_speed_m_s)
    np.testing.assert_allclose(np.column_stack(ours), expected, rtol=1e-5, atol=1e-7)


def test_without_friction_and_damping_energy_stays() -> None:
    drive = replace(DRIVE, friction=SMOOTH, shaft_damping_nm_s_per_rad=0.0)
    time_s, start = np.linspace(0.0, 0.05, 101), np.array([5e-3, 3.0, 0.0, 0.0])
    run = simulate(drive, time_s, np.zeros(101), np.zeros(101), start)
    energy = energy_j(drive, run)
    np.testing.assert_allclose(energy, energy[0], rtol=2e-5)


def test_work_done_is_energy_stored_and_energy_lost() -> None:
    """Lost in friction and shaft by quadrature of force times speed: Simpson over fine samples."""
    time_s = np.linspace(0.0, 0.04, 4001)
    run = simulate(DRIVE, time_s, np.full(4001, 1.2), np.full(4001, -40.0))
    slip_rad_s = run.motor_speed_rad_s - run.table_speed_m_s / RATIO
    lost_w = GUIDE.force_n(run.table_speed_m_s) * run.table_speed_m_s
    lost_w += DRIVE.shaft_damping_nm_s_per_rad * slip_rad_s**2
    lost_j = float(np.sum(lost_w[:-1:2] + 4.0 * lost_w[1::2] + lost_w[2::2]) * 1e-5 / 3.0)
    work_j = 1.2 * run.motor_angle_rad[-1] - 40.0 * run.table_position_m[-1]
    stored_j = energy_j(DRIVE, run)[-1]
    assert lost_j > 0.1 * work_j
    assert stored_j + lost_j == pytest.approx(work_j, rel=1e-5)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_steady_speed_takes_the_friction_through_the_lead(direction: float) -> None:
    """u = R_t (F_r(v) - F) at the end, and the shaft twists by the force on the table."""
    speed_m_s = 0.05
    friction = replace(GUIDE, viscous_n_s_per_m=2e4, offset_n=15.0)
    drive = replace(DRIVE, friction=friction)
    total_n = float(friction.force_n(direction * speed_m_s))
    run = held(drive, RATIO * (total_n + 30.0), -30.0, 0.2)
    assert run.table_speed_m_s[-1] == pytest.approx(direction * speed_m_s, rel=1e-4)
    assert run.motor_speed_rad_s[-1] == pytest.approx(direction * speed_m_s / RATIO, rel=1e-4)
    twist_rad = run.motor_angle_rad[-1] - run.table_position_m[-1] / RATIO
    assert twist_rad == pytest.approx(RATIO * (total_n + 30.0) / 350.0, rel=1e-4)


def test_below_breakaway_it_creeps_above_it_runs() -> None:
    below, above = (held(DRIVE, RATIO * force_n, 0.0, 0.3) for force_n in (60.0, 110.0))
    assert 0.0 < below.table_speed_m_s[-1] < GUIDE.breakaway_speed_m_s
    assert GUIDE.force_n(below.table_speed_m_s[-1]) == pytest.approx(60.0, rel=1e-3)
    assert above.table_speed_m_s[-1] > 5.0 * GUIDE.breakaway_speed_m_s


def test_opposite_inputs_give_the_opposite_motion() -> None:
    one, other = held(DRIVE, 0.8, -70.0, 0.05), held(DRIVE, -0.8, 70.0, 0.05)
    np.testing.assert_allclose(one.table_position_m, -other.table_position_m, atol=1e-12)
    np.testing.assert_allclose(one.motor_angle_rad, -other.motor_angle_rad, atol=1e-9)


@settings(deadline=None)
@given(
    state=st.tuples(
        st.floats(-1.0, 1.0), st.floats(-50.0, 50.0), st.floats(-0.01, 0.01), st.floats(-0.1, 0.1)
    )
)
def test_jacobian_is_the_derivative(state: tuple[float, float, float, float]) -> None:
    """Complex step through the right-hand side, column by column."""
    screw = Friction(20.0, 30.0, 4e-3, 2e-4, 50.0)
    drive = replace(DRIVE, screw_friction=screw)
    at = np.array(state)
    columns = [
        drive.derivative(at + 1e-30j * unit, 0.0, 0.0).imag / 1e-30 for unit in np.eye(STATE_SIZE)
    ]
    expected = np.column_stack(columns)
    np.testing.assert_allclose(drive.jacobian(at), expected, rtol=1e-7, atol=1e-6)


def test_linearised_drive_follows_small_deviations_only() -> None:
    speed_m_s = 0.05
    start = np.array([0.0, speed_m_s / RATIO, 0.0, speed_m_s])
    needed_n = float(GUIDE.force_n(speed_m_s))
    start[0] = RATIO * needed_n / DRIVE.shaft_stiffness_nm_per_rad
    time_s = np.arange(51) * 1e-3
    extra = np.zeros((51, 2))
    extra[5:10, 0] = 0.01
    linear = DRIVE.linearised(speed_m_s / RATIO, speed_m_s).sampled(1e-3).respond(extra)
    run = simulate(DRIVE, time_s, RATIO * needed_n + extra[:, 0], extra[:, 1], start)
    deviation = run.table_speed_m_s - speed_m_s
    np.testing.assert_allclose(deviation, linear[:, TABLE_SPEED], atol=2e-3 * np.max(deviation))


def test_each_direction_has_its_own_friction() -> None:
    heavy = replace(GUIDE, viscous_n_s_per_m=2e4)
    light = replace(GUIDE, viscous_n_s_per_m=1e4)
    drive = replace(DRIVE, friction=DirectionalFriction(heavy, light))
    forward, backward = (held(drive, sign * 2.0, 0.0, 0.2) for sign in (1.0, -1.0))
    alone = held(replace(DRIVE, friction=heavy), 2.0, 0.0, 0.2)
    np.testing.assert_allclose(forward.table_speed_m_s, alone.table_speed_m_s, rtol=1e-6)
    assert -backward.table_speed_m_s[-1] > 1.5 * forward.table_speed_m_s[-1]


def test_fast_plant_moves_as_the_component_model_does(plant: Plant) -> None:
    """Reversals with dry friction on both sides of the spring; the plant sticks, this creeps."""
    dry = plant._replace(guide_force_n=60.0, bearing_drag_nm=0.0)
    compliance, drag_nm = axial_compliance(dry, 0.4, 6.8), 0.146
    reference = ComponentDrive(
        motor_inertia_kg_m2=dry.motor_inertia_kg_m2,
        shaft_inertia_kg_m2=0.0,
        shaft_stiffness_nm_per_rad=RATIO**2 / compliance,
        shaft_damping_nm_s_per_rad=dry.damping_n_s_per_m * RATIO**2,
        ratio_m_per_rad=RATIO,
        platform_mass_kg=dry.table_mass_kg,
        friction=Friction(60.0, 60.0, 1.0, 1e-5),
        screw_friction=Friction(
            drag_nm / RATIO,
            drag_nm / RATIO,
            1.0,
            1e-5,
            viscous_n_s_per_m=dry.motor_viscous_nm_s_per_rad / RATIO**2,
        ),
    )
    count, period_s = 160, 1e-3
    time_s = np.arange(count) * period_s
    torque_nm = np.where(np.arange(count) // 40 % 2 == 0, 1.5, -1.5)
    force_n = np.where(np.arange(count) < 100, 0.0, -80.0)
    run = simulate(reference, time_s, torque_nm, force_n)
    state, travel = np.zeros(PLANT_SIZE), np.empty((count, 4))
    for k in range(count):
        travel[k] = state[:4]
        advance_plant(dry, state, Load(torque_nm[k], force_n[k], drag_nm, compliance), period_s, 64)
    assert np.ptp(run.table_position_m) > 1e-3
    moved_m = np.ptp(travel[:, 2])
    np.testing.assert_allclose(travel[:, 2], run.table_position_m, atol=2e-3 * moved_m)
    np.testing.assert_allclose(
        travel[:, 0] / RATIO, run.motor_angle_rad, atol=2e-3 * moved_m / RATIO
    )
    np.testing.assert_allclose(
        travel[:, 3], run.table_speed_m_s, atol=5e-3 * np.ptp(run.table_speed_m_s)
    )


@pytest.mark.parametrize(
    ("name", "values", "word"),
    [
        ("time_s", [0.0, 0.0, 0.1], "time_s: expected at least two times, increasing"),
        ("time_s", [0.0], "time_s: expected at least two"),
        ("torque_nm", [0.0, 1.0], "torque_nm: expected finite numbers of shape"),
        ("force_n", [0.0, math.nan, 0.0], "force_n: expected finite"),
        ("start", [0.0, 0.0], "start: expected finite"),
    ],
)
def test_impossible_inputs_are_refused(name: str, values: list[float], word: str) -> None:
    inputs = {"time_s": [0.0, 0.1, 0.2], "torque_nm": [0.0] * 3, "force_n": [0.0] * 3}
    arrays = {key: np.array(row) for key, row in (inputs | {name: values}).items()}
    with pytest.raises(ValueError, match=f"^{word}[^\n]*$"):
        simulate(DRIVE, **arrays)


def test_impossible_drives_are_refused() -> None:
    with pytest.raises(ValueError, match=r"^platform_mass_kg must"):
        replace(DRIVE, platform_mass_kg=0.0)
    with pytest.raises(ValueError, match=r"^shaft_damping_nm_s_per_rad must"):
        replace(DRIVE, shaft_damping_nm_s_per_rad=-1.0)
