import itertools
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from edge_service.messages.samples import Floats
from edge_service.models.effects.forward import put_into
from edge_service.models.effects.registry import parse_effect
from edge_service.models.machine import Machine
from edge_service.models.plant import two_mass
from edge_service.models.plant.accelerometer import (
    REFERENCE_SPEED_RAD_S,
    Accelerometer,
    AccelerometerSettings,
)
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import (
    Load,
    Plant,
    advance_plant,
    axial_compliance,
    resistance,
)

PERIOD_S = 1e-3
START_M = 0.4
PRELOAD_PERCENT = 6.8
MOTION = slice(two_mass.MOTOR_TRAVEL, two_mass.TABLE_SPEED + 1)
SPEED = 2.0 * math.pi * 5.0
QUIET = {"noise": 0.0, "ball_pass": 0.0}


def with_effects(plant: Plant, *texts: str) -> Plant:
    return put_into(plant, [parse_effect(text) for text in texts], 0.0).plant


def at_rest() -> Floats:
    state = np.zeros(two_mass.STATE_SIZE)
    state[[two_mass.MOTOR_TRAVEL, two_mass.TABLE_POSITION]] = START_M
    return state


def compliance(plant: Plant) -> float:
    return axial_compliance(plant, START_M, PRELOAD_PERCENT)


def run(
    plant: Plant,
    torque_nm: Floats,
    *,
    force_n: float = 0.0,
    drag_nm: float = 0.0,
    period_s: float = PERIOD_S,
    substeps: int = 16,
    state: Floats | None = None,
) -> Floats:
    """States before and after each period, (n + 1, STATE_SIZE), at a fixed compliance."""
    state = at_rest() if state is None else state
    states = [state.copy()]
    for torque in torque_nm:
        load = Load(float(torque), force_n, drag_nm, compliance(plant))
        advance_plant(plant, state, load, period_s, substeps)
        states.append(state.copy())
    return np.array(states)


def linear_model(plant: Plant) -> tuple[Floats, Floats]:
    """Continuous model of (5.3.21) in travel coordinates: state matrix and torque input."""
    m1, m2, ratio = plant.motor_mass_kg, plant.table_mass_kg, plant.ratio_m_per_rad
    k, c = 1.0 / compliance(plant), plant.damping_n_s_per_m
    d1, d2 = plant.motor_viscous_nm_s_per_rad / ratio**2, plant.table_viscous_n_s_per_m
    matrix = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [-k / m1, -(c + d1) / m1, k / m1, c / m1],
            [0.0, 0.0, 0.0, 1.0],
            [k / m2, c / m2, -k / m2, -(c + d2) / m2],
        ]
    )
    return matrix, np.array([0.0, 1.0 / (m1 * ratio), 0.0, 0.0])


def reference(plant: Plant, torque_nm: float, friction_n: tuple[float, float]) -> Floats:
    """State after 50 ms of sliding forwards, by an independent integrator, (4,)."""
    matrix, drive = linear_model(plant)
    rest = np.array([START_M, 0.0, START_M, 0.0])
    masses = np.array([plant.motor_mass_kg, plant.table_mass_kg])
    dry = np.zeros(4)
    dry[[1, 3]] = np.array(friction_n) / masses
    solution = solve_ivp(
        lambda _t, s: matrix @ (s - rest) + drive * torque_nm - dry,
        (0.0, 0.05),
        rest + np.array([0.0, 0.1, 0.0, 0.1]),
        method="DOP853",
        rtol=1e-10,
        atol=1e-14,
    )
    return np.asarray(solution.y[:, -1])


@pytest.mark.parametrize("guide_force_n", [0.0, 60.0])
def test_sliding_agrees_with_an_independent_integrator(plant: Plant, guide_force_n: float) -> None:
    plant = plant._replace(guide_force_n=guide_force_n, bearing_drag_nm=0.05)
    drag_nm = 0.146
    friction_n = ((drag_nm + 0.05) / plant.ratio_m_per_rad, guide_force_n)
    expected = reference(plant, 1.0, friction_n)
    errors_m = []
    for substeps in (16, 32, 64):
        state = at_rest()
        state[[two_mass.MOTOR_SPEED, two_mass.TABLE_SPEED]] = 0.1
        states = run(plant, np.full(50, 1.0), drag_nm=drag_nm, substeps=substeps, state=state)
        errors_m.append(float(np.max(np.abs(states[-1, :4] - expected) * [1, 1e-3, 1, 1e-3])))
    assert errors_m[0] < 2e-8
    orders = np.log2(np.array(errors_m[:-1]) / np.array(errors_m[1:]))
    assert orders == pytest.approx([2.0, 2.0], abs=0.1)


def test_friction_through_reversals_converges_with_the_substeps(plant: Plant) -> None:
    plant = with_effects(plant._replace(guide_force_n=60.0), "stribeck:excess_nm=0.1")
    torque_nm = 1.0 * np.sin(2.0 * math.pi * 5.0 * np.arange(400) * PERIOD_S)
    finest = run(plant, torque_nm, drag_nm=0.146, substeps=1024)
    errors_m = [
        float(np.max(np.abs(run(plant, torque_nm, drag_nm=0.146, substeps=n) - finest)[:, 0]))
        for n in (16, 64, 256)
    ]
    travel_m = float(np.ptp(finest[:, two_mass.MOTOR_TRAVEL]))
    assert errors_m[0] < 1e-3 * travel_m
    assert errors_m[1] < errors_m[0] / 3.0
    assert errors_m[2] < errors_m[1] / 3.0


def test_work_of_the_torque_is_kept_or_turned_to_heat(plant: Plant) -> None:
    """Input work = kinetic + spring energy + viscous, damper and Coulomb heat, to 1e-6 of it."""
    plant = plant._replace(guide_force_n=60.0, bearing_drag_nm=0.05, table_viscous_n_s_per_m=40.0)
    h, ratio, drag_nm = 1.0 / 16_000.0, plant.ratio_m_per_rad, 0.146
    torque_nm = np.repeat(1.5 * np.sin(2.0 * math.pi * 4.0 * np.arange(500) * PERIOD_S), 16)
    states = run(plant, torque_nm, drag_nm=drag_nm, period_s=h, substeps=1)
    travel = np.diff(states[:, [two_mass.MOTOR_TRAVEL, two_mass.TABLE_POSITION]], axis=0)
    kinetic = 0.5 * (
        plant.motor_mass_kg * states[:, two_mass.MOTOR_SPEED] ** 2
        + plant.table_mass_kg * states[:, two_mass.TABLE_SPEED] ** 2
    )
    stretch = states[:, two_mass.MOTOR_TRAVEL] - states[:, two_mass.TABLE_POSITION]
    stored = kinetic + 0.5 * stretch**2 / compliance(plant)
    viscous = plant.motor_viscous_nm_s_per_rad / ratio**2 * travel[:, 0] ** 2 / h
    viscous += plant.table_viscous_n_s_per_m * travel[:, 1] ** 2 / h
    damper = plant.damping_n_s_per_m * (travel[:, 0] - travel[:, 1]) ** 2 / h
    rubbed = np.sum(np.abs(travel), axis=0) @ [(drag_nm + 0.05) / ratio, plant.guide_force_n]
    work = np.sum(torque_nm / ratio * travel[:, 0])
    gross = np.sum(np.abs(torque_nm / ratio * travel[:, 0]))
    heat = np.sum(viscous) + np.sum(damper) + rubbed
    assert work == pytest.approx(stored[-1] - stored[0] + heat, abs=1e-6 * gross)
    assert heat > 0.2 * gross


@pytest.mark.parametrize("share", [-0.999, 0.0, 0.999])
def test_torque_below_the_breakaway_moves_nothing_at_all(plant: Plant, share: float) -> None:
    plant = with_effects(plant, "stribeck:excess_nm=0.1")
    states = run(plant, np.full(500, share * 0.246), drag_nm=0.146)
    assert np.array_equal(states[:, MOTION], np.repeat(states[:1, MOTION], 501, axis=0))


def test_table_sticks_in_its_guides_while_the_screw_winds_up(plant: Plant) -> None:
    plant = plant._replace(guide_force_n=60.0)
    torque_nm = 0.4 * 60.0 * plant.ratio_m_per_rad
    states = run(plant, np.full(4000, torque_nm))
    assert np.all(states[:, two_mass.TABLE_POSITION] == START_M)
    wound_m = states[-1, two_mass.MOTOR_TRAVEL] - START_M
    assert wound_m == pytest.approx(24.0 * compliance(plant), rel=1e-6)


def test_a_sliding_axis_comes_to_an_exact_stop_after_its_braking_distance(machine: Machine) -> None:
    plant = plant_of(machine)._replace(motor_viscous_nm_s_per_rad=0.0)
    state = at_rest()
    state[[two_mass.MOTOR_SPEED, two_mass.TABLE_SPEED]] = speed = 0.05
    states = run(plant, np.zeros(400), drag_nm=0.146, state=state)
    assert states[-1, two_mass.MOTOR_SPEED] == 0.0
    total_kg = machine.model.inertia_kg_m2.value / plant.ratio_m_per_rad**2
    braking_m = 0.5 * total_kg * speed**2 / (0.146 / plant.ratio_m_per_rad)
    assert states[-1, two_mass.MOTOR_TRAVEL] - START_M == pytest.approx(braking_m, rel=2e-3)


def test_parts_of_the_friction_never_make_it_push(plant: Plant) -> None:
    plant = with_effects(plant, "once_per_rev_friction:amplitude_nm=1.0")
    load = Load(0.0, 0.0, 0.146, compliance(plant))
    turn_m = 2.0 * math.pi * plant.ratio_m_per_rad
    levels = [resistance(plant, load, x, 0.0, 0.0)[0] for x in np.linspace(0.0, turn_m, 100)]
    assert min(level.forward_n for level in levels) == 0.0
    greatest_n = (0.146 + 1.0) / plant.ratio_m_per_rad
    assert max(level.forward_n for level in levels) == pytest.approx(greatest_n, rel=1e-3)


def test_compiled_and_plain_python_agree(plant: Plant) -> None:
    plant = plant._replace(guide_force_n=60.0)
    torque_nm = 1.0 * np.sin(np.arange(50) / 8.0)
    compiled_states = run(plant, torque_nm, drag_nm=0.146)
    state = at_rest()
    for torque in torque_nm:
        load = Load(float(torque), 0.0, 0.146, compliance(plant))
        advance_plant.py_func(plant, state, load, PERIOD_S, 16)  # type: ignore[attr-defined]
    assert state == pytest.approx(compiled_states[-1], rel=1e-12)


def test_a_table_heavier_than_the_inertia_is_refused(machine: Machine) -> None:
    model = machine.model.model_copy(update={"table_mass_kg": machine.model.preload_n})
    with pytest.raises(ValueError, match="leaves nothing for the motor"):
        plant_of(machine.model_copy(update={"model": model}))


def follow(settings: AccelerometerSettings, seconds: float = 2.0, block: int = 20) -> Floats:
    time_s = np.arange(round(1000 * seconds)) / 1000.0
    sensor = Accelerometer(settings, 1)
    waves = [
        sensor.follow(time_s[k : k + block], SPEED * time_s[k : k + block])
        for k in range(0, len(time_s), block)
    ]
    for before, after in itertools.pairwise(waves):
        assert after.start_s == pytest.approx(before.end_s, abs=1e-9)
    return np.concatenate([wave.values for wave in waves])


@pytest.mark.parametrize("rate_hz", [10_000.0, 25_600.0])
def test_values_come_at_the_sensor_s_own_rate_without_a_hole(rate_hz: float) -> None:
    values = follow(AccelerometerSettings(rate_hz=rate_hz))
    assert len(values) == pytest.approx(2.0 * rate_hz, abs=rate_hz / 900.0)


def test_any_split_gives_the_same_signal() -> None:
    settings = AccelerometerSettings(damage=3.0, noise=0.0)
    np.testing.assert_allclose(follow(settings, block=20), follow(settings, block=7), atol=1e-9)


def test_the_tone_stands_at_the_ball_pass_frequency() -> None:
    settings = AccelerometerSettings(noise=0.0, ball_pass=1.0, ball_pass_order=9.56)
    values = follow(settings)
    spectrum = np.abs(np.fft.rfft(values * np.hanning(len(values))))
    frequency = np.fft.rfftfreq(len(values), 1e-4)
    assert frequency[np.argmax(spectrum)] == pytest.approx(9.56 * 5.0, abs=0.5)
    assert np.max(values) == pytest.approx(SPEED / REFERENCE_SPEED_RAD_S, rel=0.01)


def test_every_ball_strikes_the_pit_once_and_it_rings_out() -> None:
    settings = AccelerometerSettings(**QUIET, damage=2.0, ball_pass_order=10.0)
    values = follow(settings)
    loud = np.flatnonzero(np.abs(values) > 0.3)
    strikes = loud[np.concatenate([[True], np.diff(loud) > 100])]
    assert len(strikes) == pytest.approx(10.0 * 5.0 * 2.0, abs=2)
    step_s = np.median(np.diff(strikes)) / 10_000.0
    assert step_s == pytest.approx(1.0 / 50.0, rel=0.01)
    swing = np.max(np.abs(values))
    expected = 2.0 * SPEED / REFERENCE_SPEED_RAD_S
    assert 0.7 * expected < swing < 1.05 * expected
