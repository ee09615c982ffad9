"""The plant with effects in it: accuracy, energy, stability, and what one run shows of each."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.messages import samples as channels
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.forward import put_into
from edge_service.models.effects.registry import effect_names, parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import Dwell, Move, Setpoints
from edge_service.models.plant import two_mass
from edge_service.models.plant.closed_loop import Sensors
from edge_service.models.plant.two_mass import Load, Plant, advance_plant, axial_compliance

IDEAL = Sensors(*[0.0] * len(Sensors._fields))
START_M, HOME_M, PERCENT = 0.4, 0.2, 6.8


def with_effects(plant: Plant, *texts: str) -> Plant:
    return put_into(plant, [parse_effect(text) for text in texts], 0.146).plant


def moving(speed_m_s: float) -> Floats:
    state = np.zeros(two_mass.STATE_SIZE)
    state[[two_mass.MOTOR_TRAVEL, two_mass.TABLE_POSITION]] = START_M
    state[[two_mass.MOTOR_SPEED, two_mass.TABLE_SPEED]] = speed_m_s
    return state


def drive(machine: Machine, *texts: str, **plant: float) -> FeedDriveSettings:
    effects = [parse_effect(text) for text in texts]
    settings = FeedDriveSettings.of_machine(machine, effects=effects)
    return replace(settings, sensors=IDEAL, plant=settings.plant._replace(**plant))


def follow(settings: FeedDriveSettings, *segments: Move | Dwell) -> SampleFrame:
    count = math.ceil(1000.0 * sum(segment.duration_s for segment in segments))
    setpoints = Setpoints(iter(segments), HOME_M, 1000.0).take(count)
    return FeedDrive(settings, HOME_M, PERCENT, seed=1).advance(setpoints, np.full(count, PERCENT))


@pytest.mark.parametrize(
    "text",
    [
        "stribeck:excess_nm=0.4",
        "load_offset:constant_nm=0,asymmetry_nm=0.1",
        "position_friction:excess_nm=0.5,centre_m=0.4,width_m=0.003",
        "once_per_rev_friction:amplitude_nm=0.3",
        "load_friction:coefficient=0.4",
    ],
)
def test_dry_friction_never_gives_energy(plant: Plant, text: str) -> None:
    rubbing, state, h = with_effects(plant._replace(guide_force_n=60.0), text), moving(0.0), 6.25e-5
    compliance = axial_compliance(rubbing, START_M, PERCENT)
    heat = []
    for k in range(8000):
        before = state.copy()
        torque_nm = 1.2 * math.sin(2.0 * math.pi * 4.0 * k * h)
        advance_plant(rubbing, state, Load(torque_nm, 0.0, 0.146, compliance), h, 1)
        heat.append(state[two_mass.MOTOR_FRICTION] * state[two_mass.MOTOR_SPEED])
        heat.append(state[two_mass.TABLE_FRICTION] * state[two_mass.TABLE_SPEED])
        assert abs(state[two_mass.MOTOR_TRAVEL] - before[two_mass.MOTOR_TRAVEL]) < 1e-3
    assert min(heat) >= 0.0
    assert sum(heat) > 0.0


def test_presliding_is_a_spring_that_dissipates_over_a_cycle(plant: Plant) -> None:
    """Half of the level moves it by half of the reach, and a greater swing encloses an area."""
    soft = with_effects(plant, "presliding:reach_m=2e-5")
    level_n = 0.146 / soft.ratio_m_per_rad
    compliance = axial_compliance(soft, START_M, PERCENT)
    for share, elastic in ((0.45, True), (0.95, False)):
        state, work, travel = moving(0.0), 0.0, []
        for k in range(8000):
            torque_nm = share * 0.146 * math.sin(2.0 * math.pi * 0.5 * k * 1e-3)
            before, held_n = state[two_mass.MOTOR_TRAVEL], state[two_mass.MOTOR_FRICTION]
            advance_plant(soft, state, Load(torque_nm, 0.0, 0.146, compliance), 1e-3, 16)
            moved = state[two_mass.MOTOR_TRAVEL] - before
            travel.append(state[two_mass.MOTOR_TRAVEL] - START_M)
            work += 0.5 * (held_n + state[two_mass.MOTOR_FRICTION]) * moved if k >= 4000 else 0.0
        if elastic:
            assert max(travel) == pytest.approx(share * 2e-5, rel=0.02)
            assert abs(work) < 1e-3 * level_n * 2e-5
        else:
            assert max(travel) > 1.2 * share * 2e-5
            assert work > 0.1 * level_n * 2e-5


def test_skew_shifts_the_linear_channel_of_the_record_alone(machine: Machine) -> None:
    move = Move(0.2, 0.3, 3.0, 100.0)
    plain = follow(drive(machine), move).channels
    late = follow(drive(machine, "timestamp_skew:skew_s=2e-3"), move).channels
    half = follow(drive(machine, "timestamp_skew:skew_s=1.5e-3"), move).channels
    early = follow(drive(machine, "timestamp_skew:skew_s=-1e-3"), move).channels
    table = plain[channels.TABLE_POSITION]
    for name in (channels.ANGLE, channels.TORQUE, channels.MOTOR_SPEED):
        assert np.array_equal(late[name], plain[name])
    assert late[channels.TABLE_POSITION][2:] == pytest.approx(table[:-2], abs=1e-15)
    middle = 0.5 * (table[1:-1] + table[:-2])
    assert half[channels.TABLE_POSITION][2:] == pytest.approx(middle, abs=1e-6)
    assert early[channels.TABLE_POSITION][:-1] == pytest.approx(table[1:], abs=2e-7)
    assert np.max(np.diff(table)) > 2.9e-4


def test_saturation_cuts_the_torque_and_not_the_command(machine: Machine) -> None:
    frame = follow(drive(machine, "saturation:limit_nm=0.5"), Move(0.4, 0.5, 4.0, 200.0))
    angle = frame.channels[channels.ANGLE]
    acceleration = np.gradient(np.gradient(angle, 1e-3), 1e-3)
    assert np.max(np.abs(frame.channels[channels.TORQUE])) > 0.6
    assert np.max(acceleration[100:200]) < (0.5 - 0.146) / 1.5e-3 * 1.02


@pytest.mark.parametrize("substeps", [2, 4, 16])
def test_all_effects_at_once_stay_bounded(machine: Machine, substeps: int) -> None:
    names = [name for name in effect_names() if name != "saturation"]
    settings = replace(drive(machine, *names, guide_force_n=60.0), substeps=substeps)
    frame = follow(settings, Move(0.4, 0.5, 4.0, 200.0), Dwell(0.3), Move(-0.4, 0.5, 4.0, 200.0))
    error = frame.channels[channels.SETPOINT] - frame.channels[channels.TABLE_POSITION]
    assert np.isfinite(frame.channels[channels.TORQUE]).all()
    assert np.max(np.abs(error)) < 1e-3


@pytest.mark.parametrize("share", [0.0, 0.4])
def test_friction_is_moved_behind_spring_and_stays_the_same(machine: Machine, share: float) -> None:
    plant = FeedDriveSettings.of_machine(machine).plant._replace(guide_force_n=80.0)
    text = f"compliance:level_m_per_n=1e-8,friction_share={share},viscous_share=0.3"
    moved = with_effects(plant, text)
    ratio = plant.ratio_m_per_rad
    assert moved.guide_force_n == pytest.approx(share * 80.0)
    assert moved.guide_force_n * ratio + moved.bearing_drag_nm == pytest.approx(
        80.0 * ratio + plant.bearing_drag_nm
    )
