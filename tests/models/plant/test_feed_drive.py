import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.messages import samples as channels
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.registry import effect_names, parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Dwell, Move, Setpoints, motion_limits
from edge_service.models.plant.closed_loop import Sensors
from edge_service.models.plant.controller import command_torque, gains_for
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import axial_compliance

IDEAL = Sensors(*[0.0] * len(Sensors._fields))
HOME_M = 0.04
FRESH = 6.8
INERTIA, RATIO, LIMIT_NM = 1.5e-3, 0.02 / (2.0 * math.pi), 16.0
GAINS = gains_for(INERTIA, RATIO, LIMIT_NM, 1e-3)


def bench(machine: Machine, sensors: Sensors = IDEAL, **plant: float) -> FeedDriveSettings:
    drive = FeedDriveSettings.of_machine(machine)
    return replace(drive, sensors=sensors, plant=drive.plant._replace(**plant))


def production(machine: Machine, count: int, seed: int = 1) -> Floats:
    segments = MOTIONS["production"](motion_limits(machine), np.random.default_rng(seed))
    return Setpoints(segments, HOME_M, 1000.0).take(count)


def moves(*segments: Move | Dwell, count: int) -> Floats:
    return Setpoints(iter(segments), HOME_M, 1000.0).take(count)


def run(drive: FeedDriveSettings, setpoints: Floats, percent: float = FRESH) -> SampleFrame:
    axis = FeedDrive(drive, HOME_M, percent, seed=1)
    return axis.advance(setpoints, np.full(len(setpoints), percent))


def as_bytes(*frames: SampleFrame) -> list[bytes]:
    parts = [np.concatenate([f.time_s for f in frames]).tobytes()]
    parts += [np.concatenate([f.channels[e] for f in frames]).tobytes() for e in frames[0].channels]
    return parts


@settings(deadline=None, max_examples=25)
@given(cuts=st.lists(st.integers(0, 2000), max_size=8))
def test_any_split_into_blocks_gives_the_same_bytes(cuts: list[int]) -> None:
    machine = Machine.model_validate(
        {
            "axis": {"lead_m": 0.02, "dynamic_load_rating_n": 7450.0},
            "model": {
                "inertia_kg_m2": 1.5e-3,
                "preload_drag_nm": 0.146,
                "preload_n": 510.0,
                "guide_force_n": 60.0,
            },
        }
    )
    effects = tuple(parse_effect(name) for name in effect_names())
    drive = replace(bench(machine, Sensors()), effects=effects)
    setpoints, percent = production(machine, 2000), np.linspace(10.0, 5.0, 2000)
    whole = FeedDrive(drive, HOME_M, 10.0, seed=5).advance(setpoints, percent)
    axis = FeedDrive(drive, HOME_M, 10.0, seed=5)
    edges = [0, *sorted(cuts), 2000]
    parts = [axis.advance(setpoints[a:b], percent[a:b]) for a, b in itertools.pairwise(edges)]
    assert as_bytes(*parts) == as_bytes(whole)


def test_momentum_of_recorded_samples_balances_over_every_tenth_of_second(machine: Machine) -> None:
    """J d omega = sum T (u_k - viscous - drag sgn(omega)) over intervals of unbroken motion."""
    frame = run(bench(machine), production(machine, 20_000))
    torque = frame.channels[channels.TORQUE]
    angle = frame.channels[channels.ANGLE]
    speed = np.gradient(angle, 1e-3)
    checked = 0
    for a in range(100, 19_800, 100):
        b = a + 100
        inside = speed[a - 2 : b + 3]
        if np.min(np.abs(inside)) < 1.0 or np.ptp(np.sign(inside)) > 0:
            continue
        drag = FRESH * 0.146 / (100.0 * 510.0 / 7450.0)
        impulse = 1e-3 * np.sum(torque[a:b]) - 0.1 * drag * np.sign(inside[0])
        impulse -= 5e-3 * (angle[b] - angle[a])
        assert impulse == pytest.approx(1.5e-3 * (speed[b] - speed[a]), abs=2e-3 * 0.1)
        checked += 1
    assert checked > 50


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_constant_speed_takes_viscous_screw_bearing_and_guide_torque(
    machine: Machine, direction: float
) -> None:
    drive = bench(machine, guide_force_n=60.0, bearing_drag_nm=0.05)
    there = Move(0.3, 0.3, 4.0, 200.0)
    slow = Move(direction * 0.1, 0.05, 4.0, 200.0)
    torque = run(drive, moves(there, Dwell(0.2), slow, count=3000)).channels[channels.TORQUE]
    ratio = drive.plant.ratio_m_per_rad
    friction = FRESH * drive.drag_per_percent_nm + 0.05 + 60.0 * ratio
    expected = direction * (5e-3 * 0.05 / ratio + friction)
    assert np.mean(torque[2400:2900]) == pytest.approx(expected, rel=2e-3)


def test_stretch_is_force_over_stiffness_at_the_place_and_preload(machine: Machine) -> None:
    drive = bench(machine, guide_force_n=60.0, bearing_drag_nm=0.2)
    there, back = Move(0.3, 0.05, 4.0, 200.0), Move(-0.2, 0.05, 4.0, 200.0)
    setpoints = moves(there, Dwell(0.2), back, count=9000)
    for percent in (FRESH, 2.0):
        frame = run(drive, setpoints, percent)
        angle, table = frame.channels[channels.ANGLE], frame.channels[channels.TABLE_POSITION]
        delta = drive.plant.ratio_m_per_rad * angle - table
        home_m = 60.0 * axial_compliance(drive.plant, HOME_M, percent)
        for k, sign in ((4000, 1.0), (8500, -1.0)):
            force_m = sign * 60.0 * axial_compliance(drive.plant, float(table[k]), percent)
            assert delta[k] == pytest.approx(force_m - home_m, abs=2e-9)


def test_home_is_at_rest_with_both_encoders_equal(machine: Machine) -> None:
    drive = bench(machine, guide_force_n=40.0)
    frame = run(drive, moves(Dwell(1.0), count=500))
    ratio = drive.plant.ratio_m_per_rad
    assert np.all(frame.channels[channels.TABLE_POSITION] == HOME_M)
    assert frame.channels[channels.ANGLE] * ratio == pytest.approx(HOME_M, rel=1e-12)
    assert np.ptp(frame.channels[channels.ANGLE]) == 0.0


def test_sensor_noise_has_its_stated_size(machine: Machine) -> None:
    quiet = run(bench(machine), moves(Dwell(9.0), count=4000))
    noisy = run(
        bench(machine, Sensors(), guide_force_n=100.0, bearing_drag_nm=3.0),
        moves(Dwell(9.0), count=4000),
    )
    for name, size in (
        (channels.ANGLE, 5e-6),
        (channels.MOTOR_SPEED, 0.01),
        (channels.TABLE_POSITION, 5e-8),
        (channels.TABLE_SPEED, 5e-5),
        (channels.EXTERNAL_FORCE, 1.0),
        (channels.TEMPERATURE, 0.02),
    ):
        noise = noisy.channels[name] - quiet.channels[name]
        assert np.std(noise) == pytest.approx(size, rel=0.06)
        assert abs(np.mean(noise)) < 4.0 * size / np.sqrt(4000.0)
    steps = noisy.channels[channels.TABLE_POSITION] / 1e-8
    assert np.max(np.abs(steps - np.round(steps))) < 1e-6


def test_torque_never_exceeds_the_limit(machine: Machine) -> None:
    axis = machine.axis.model_copy(update={"max_torque_nm": 1.0, "max_acceleration_m_s2": 4.0})
    limited = machine.model_copy(update={"axis": axis})
    setpoints = moves(Move(0.5, 0.5, 4.0, 200.0), count=3000)
    frame = run(bench(limited), setpoints)
    torque = frame.channels[channels.TORQUE]
    assert np.max(np.abs(torque)) == 1.0
    error = frame.channels[channels.SETPOINT] - frame.channels[channels.TABLE_POSITION]
    assert abs(error[-1]) < 1e-5


def test_known_nut_stiffness_is_that_of_the_fresh_nut(machine: Machine) -> None:
    model = machine.model.model_copy(update={"nut_stiffness_n_per_m": machine.model.preload_n})
    plant = plant_of(machine.model_copy(update={"model": model}))
    fresh = 100.0 * 510.0 / 7450.0
    screw_and_support = axial_compliance(plant, 0.3, fresh) - 1.0 / 510.0
    others = axial_compliance(plant_of(machine), 0.3, fresh)
    assert 0.0 < screw_and_support < others


def test_bad_input_is_refused_before_it_reaches_the_plant(machine: Machine) -> None:
    axis = FeedDrive(bench(machine), HOME_M, FRESH, seed=1)
    with pytest.raises(ValueError, match=r"preload_percent: expected .* shape \(10,\)"):
        axis.advance(moves(Dwell(1.0), count=10), np.full(9, FRESH))
    with pytest.raises(ValueError, match="setpoints: expected finite"):
        axis.advance(np.full((10, 3), np.nan), np.full(10, FRESH))


def test_without_a_known_preload_the_whole_coulomb_level_is_on_the_guides(machine: Machine) -> None:
    model = machine.model.model_copy(update={"preload_n": None})
    drive = bench(machine.model_copy(update={"model": model}))
    ratio = drive.plant.ratio_m_per_rad
    assert drive.screw_drag_nm(5.0) == 0.0
    assert drive.plant.guide_force_n * ratio == pytest.approx(0.146)
    slow = Move(0.1, 0.05, 4.0, 200.0)
    torque = run(drive, moves(slow, count=2000), 5.0).channels[channels.TORQUE]
    assert np.mean(torque[1000:1900]) == pytest.approx(5e-3 * 0.05 / ratio + 0.146, rel=2e-3)


def test_without_a_load_rating_the_drag_does_not_follow_the_preload(machine: Machine) -> None:
    axis = machine.axis.model_copy(update={"dynamic_load_rating_n": None})
    drive = bench(machine.model_copy(update={"axis": axis}))
    assert drive.screw_drag_nm(np.array([0.0, 10.0])).tolist() == [0.146, 0.146]


def test_speed_loop_crosses_over_at_its_bandwidth_with_margin() -> None:
    omega = np.geomspace(1.0, 3000.0, 20_000)
    s = 1j * omega
    pi = GAINS.speed_gain_nm_s_per_rad + GAINS.integral_gain_nm_per_rad / s
    lag = np.exp(-s * GAINS.period_s / 2.0) / (1.0 + s * 5e-4)
    loop = np.asarray(pi * lag / (INERTIA * s))
    crossover = np.flatnonzero(np.abs(loop) < 1.0)[0]
    assert omega[crossover] == pytest.approx(2.0 * math.pi * 60.0, rel=0.1)
    assert 180.0 + np.degrees(np.angle(loop[crossover])) > 50.0


def test_acceleration_is_fed_forward_through_the_inertia() -> None:
    torque, _ = command_torque(GAINS, np.array([0.3, 0.0, 4.0]), 0.3, 0.0, 0.0)
    assert torque == pytest.approx(INERTIA * 4.0 / RATIO)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_torque_is_limited_and_the_integral_does_not_wind_up(sign: float) -> None:
    setpoint = np.array([0.3 + sign, 0.0, 0.0])
    integral = 0.0
    for _ in range(1000):
        torque, integral = command_torque(GAINS, setpoint, 0.3, 0.0, integral)
        assert torque == sign * LIMIT_NM
    assert abs(integral) < LIMIT_NM
    overshoot_m = setpoint[0] + sign * 1e-4
    _, unwound = command_torque(GAINS, setpoint, overshoot_m, 0.0, sign * 5.0)
    assert abs(unwound) < 5.0
