"""Channels are checked by each other's motion; nothing that a sound axis does counts as a fault."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.signal import lfilter

from edge_service.checks.live.channel_limits import channel_limits
from edge_service.downsample import Downsampler, DownsampleSettings
from edge_service.messages.features import Fault, FeatureBlock
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine

OF_CHANNELS = Fault.NO_TABLE | Fault.TABLE_STUCK | Fault.TABLE_DISAGREES | Fault.TABLE_DOUBTED
OF_CHANNELS |= Fault.TABLE_SHIFTED | Fault.STUCK | Fault.TORQUE_STUCK | Fault.ANGLE_STUCK
TRUE_HZ = 2000
INERTIA_KG_M2, TABLE_KG, GUIDE_N, DRAG_NM = 1e-3, 30.0, 60.0, 0.15
COMPLIANCE_M_PER_N = 1.0 / 3e7
RESONANCE_HZ, DAMPING = 60.0, 0.1
NEITHER_BELIEVED_NOR_FAR_OFF_M = 2e-6
"""By how much the mean of a believed phase may be off: the encoder's noise, and a few rows."""


@dataclass(frozen=True)
class Axis:
    lead_m: float = 0.01
    rate_hz: int = 1000
    resolution_m: float = 1e-8
    table_every: int = 1  # rows for which the recorder holds the linear encoder's value
    play_m: float = 0.0
    growth_m: float = 0.0  # over the recording
    chatter_n: float = 0.0
    seed: int = 1

    @property
    def ratio(self) -> float:
        return self.lead_m / (2.0 * np.pi)

    @property
    def machine(self) -> Machine:
        axis = {"lead_m": self.lead_m, "screw_diameter_m": 0.02, "screw_length_m": 1.0}
        return Machine.model_validate({"axis": axis, "model": {"inertia_kg_m2": INERTIA_KG_M2}})


def moves(axis: Axis, speeds_m_s: list[float], hold_s: float = 1.0) -> Floats:
    """Speed of the screw's way at TRUE_HZ: to and fro at each speed, with rests, m/s."""
    parts = [np.zeros(TRUE_HZ // 5)]
    for speed in speeds_m_s:
        for way in (speed, -speed):
            count = max(2, int(abs(speed) / 4.0 * TRUE_HZ))
            ramp = np.linspace(0.0, way, count)
            parts += [ramp, np.full(int(hold_s * TRUE_HZ), way), ramp[::-1]]
            parts += [np.zeros(TRUE_HZ // 5)]
    return np.concatenate(parts)


def recording(axis: Axis, speed_m_s: Floats) -> dict[str, Floats]:
    """A two-mass axis with play and a resonance that is little damped, as a recorder sees it."""
    rng, count = np.random.default_rng(axis.seed), len(speed_m_s)
    way = 0.1 + np.cumsum(speed_m_s) / TRUE_HZ
    acceleration = np.gradient(speed_m_s) * TRUE_HZ
    along = np.sign(speed_m_s)
    force = TABLE_KG * acceleration + GUIDE_N * along
    chatter = np.sin(2.0 * np.pi * 35.0 * np.arange(count) / TRUE_HZ)
    force += axis.chatter_n * np.abs(along) * chatter
    turn = 2.0 * np.pi * RESONANCE_HZ / TRUE_HZ
    poles = np.exp(turn * (-DAMPING + 1j * np.sqrt(1.0 - DAMPING**2)))
    a = np.real(np.poly([poles, np.conj(poles)]))
    stretch = lfilter([a.sum()], a, COMPLIANCE_M_PER_N * force)
    table = played(way, axis.play_m) - stretch
    table += 3e-4 * (way - 0.1) + 2e-6 * np.sin(2.0 * np.pi * way / axis.lead_m)
    table += axis.growth_m * np.arange(count) / count
    torque = INERTIA_KG_M2 * acceleration / axis.ratio + axis.ratio * force + DRAG_NM * along
    rows = slice(None, None, TRUE_HZ // axis.rate_hz)
    table = table[rows] + 2e-8 * rng.standard_normal(len(table[rows]))
    table = np.round(table / axis.resolution_m) * axis.resolution_m
    table = np.repeat(table[:: axis.table_every], axis.table_every)[: len(table)]
    theta = way[rows] / axis.ratio + 5e-6 * rng.standard_normal(len(table))
    return {
        "time_s": np.arange(len(table)) / axis.rate_hz,
        TORQUE: torque[rows] + 0.01 * rng.standard_normal(len(table)),
        ANGLE: theta,
        TABLE_POSITION: table,
    }


def played(way: Floats, play_m: float) -> Floats:
    """Way of a table that is pushed by a nut with play."""
    if play_m == 0.0:
        return way.copy()
    table = np.empty_like(way)
    at = way[0]
    for row, nut in enumerate(way):
        at = min(max(at, nut - 0.5 * play_m), nut + 0.5 * play_m)
        table[row] = at
    return table


def blocks_of(axis: Axis, columns: dict[str, Floats]) -> list[FeatureBlock]:
    settings = DownsampleSettings(channels=channel_limits(axis.machine))
    return Downsampler(settings, axis.ratio).push(frame_of(columns))


def frame_of(columns: dict[str, Floats]) -> SampleFrame:
    return SampleFrame(columns["time_s"], {k: v for k, v in columns.items() if k != "time_s"})


def faults_of(blocks: list[FeatureBlock]) -> set[Fault]:
    return {kind for block in blocks for kind in block.fault & OF_CHANNELS}


def between(blocks: list[FeatureBlock], start_s: float, end_s: float) -> list[FeatureBlock]:
    """Blocks that end in (start, end + an interval]."""
    return [block for block in blocks if start_s < block.time_s <= end_s + 0.1]


EVERYDAY = [0.02, 0.0005, 0.3, 0.0001, 0.1, 0.005]
SOUND = {
    "plain": Axis(),
    "play": Axis(play_m=40e-6),
    "short lead, coarse, play": Axis(lead_m=0.005, resolution_m=1e-6, play_m=40e-6),
    "long lead, fine": Axis(lead_m=0.02, resolution_m=1e-9),
    "growth within seconds": Axis(growth_m=1e-6),
    "chatter": Axis(chatter_n=200.0, play_m=5e-6),
    "100 Hz": Axis(rate_hz=100),
    "100 Hz, coarse, play": Axis(rate_hz=100, resolution_m=1e-6, play_m=40e-6),
    "500 Hz, coarse": Axis(rate_hz=500, resolution_m=1e-6, lead_m=0.02),
    "500 Hz set into 1 kHz": Axis(table_every=2, play_m=20e-6),
    "100 Hz set into 1 kHz": Axis(table_every=10),
    "2 kHz, coarse": Axis(rate_hz=2000, resolution_m=1e-6, lead_m=0.005),
    "2 kHz, 500 Hz set in": Axis(rate_hz=2000, resolution_m=1e-6, table_every=4),
}


@pytest.mark.parametrize("name", SOUND)
def test_nothing_that_a_sound_axis_does_is_a_fault(name: str) -> None:
    axis = SOUND[name]
    blocks = blocks_of(axis, recording(axis, moves(axis, EVERYDAY)))
    assert faults_of(blocks) == set()


SLOW_AND_FAST = [0.02, 0.3, 0.02, 0.02, 0.02, 0.02, 0.02]


def damaged(
    axis: Axis, start_s: float, end_s: float, damage: Callable[[Floats, Floats], Floats]
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """A sound recording, and the same with a linear encoder that fails for a while."""
    sound = recording(axis, moves(axis, SLOW_AND_FAST))
    time_s = sound["time_s"]
    bad = (time_s >= start_s) & (time_s < end_s)
    table = sound[TABLE_POSITION].copy()
    table[bad] = damage(time_s[bad], table[bad])
    return sound, {**sound, TABLE_POSITION: table}


def stands(_: Floats, table_m: Floats) -> Floats:
    return np.full(len(table_m), table_m[0])


KINDS = [
    Axis(),
    Axis(lead_m=0.005, resolution_m=1e-6),
    Axis(lead_m=0.02, resolution_m=1e-9),
    Axis(rate_hz=500),
    Axis(rate_hz=2000, table_every=4),
    Axis(play_m=40e-6),
]


@pytest.mark.parametrize("axis", KINDS)
@pytest.mark.parametrize("start_s", [0.93, 0.955, 0.98, 1.03, 4.0])
def test_nothing_of_an_encoder_that_stands_still_is_believed(axis: Axis, start_s: float) -> None:
    end_s = start_s + 2.0
    sound, broken = damaged(axis, start_s, end_s, stands)
    good, blocks = blocks_of(axis, sound), blocks_of(axis, broken)
    assert faults_of(between(blocks, 0.0, start_s - 0.1)) == set()
    moving = [block for block in between(blocks, start_s, end_s) if block.moving_fraction > 0.5]
    found = [block for block in moving if Fault.TABLE_STUCK in block.fault]
    assert found[0].time_s <= moving[0].time_s + 0.2
    failed = [block for block in blocks if start_s + 0.3 < block.time_s < end_s]
    assert all(Fault.NO_TABLE in block.fault for block in failed)
    assert believed_error_m(axis, good, blocks) < NEITHER_BELIEVED_NOR_FAR_OFF_M + axis.resolution_m
    assert all(block.usable for block in blocks)
    assert all(phase.torque_nm == phase.torque_nm for block in blocks for phase in block.phases)


def believed_error_m(axis: Axis, good: list[FeatureBlock], blocks: list[FeatureBlock]) -> float:
    """Largest error of a table position that is believed in a phase."""
    errors = [
        abs(here.table_m - there.table_m)
        for block, sound in zip(blocks, good, strict=True)
        for here, there in zip(block.phases, sound.phases, strict=True)
        if not np.isnan(here.table_m)
    ]
    return max(errors)


def test_an_encoder_is_believed_after_a_second_of_agreement_and_its_level_is_new() -> None:
    axis = Axis()
    _, broken = damaged(axis, 0.95, 2.0, stands)
    blocks = blocks_of(axis, broken)
    back = [block for block in blocks if block.time_s > 2.05]
    agreed_s = 0.0
    for block in back:
        if Fault.NO_TABLE not in block.fault:
            break
        assert Fault.TABLE_DOUBTED in block.fault
        agreed_s += block.moving_fraction * block.duration_s
    assert 0.8 <= agreed_s <= 1.2
    assert Fault.TABLE_SHIFTED in block.fault
    after = [later for later in back if later.time_s > block.time_s]
    assert faults_of(after) == set()


@pytest.mark.parametrize("axis", KINDS)
@pytest.mark.parametrize("by_m", [0.5e-3, -0.1])
def test_a_leap_is_reported_at_once_and_the_new_level_too(axis: Axis, by_m: float) -> None:
    start_s = 0.93
    _, broken = damaged(axis, start_s, 99.0, lambda _, table_m: table_m + by_m)
    blocks = blocks_of(axis, broken)
    assert Fault.TABLE_DISAGREES in between(blocks, start_s, start_s + 0.1)[0].fault
    trial = [b for b in blocks if Fault.TABLE_DOUBTED in b.fault and b.moving_fraction > 0.5]
    assert any(Fault.TABLE_SHIFTED in block.fault for block in trial)
    assert Fault.NO_TABLE not in blocks[-1].fault


@pytest.mark.parametrize("axis", KINDS)
def test_another_scale_is_reported(axis: Axis) -> None:
    _, broken = damaged(axis, 0.5, 99.0, lambda _, x: x[0] + 1.02 * (x - x[0]))
    blocks = blocks_of(axis, broken)
    assert Fault.TABLE_DISAGREES in faults_of(between(blocks, 0.5, 1.0))


def test_an_encoder_that_comes_late_is_not_believed_for_its_slow_motion() -> None:
    axis = Axis()
    columns = recording(axis, moves(axis, [0.3, 0.02, 0.02, 0.02, 0.005]))
    late = np.r_[np.full(10, columns[TABLE_POSITION][0]), columns[TABLE_POSITION][:-10]]
    blocks = blocks_of(axis, {**columns, TABLE_POSITION: late})
    parted = [Fault.TABLE_DISAGREES in block.fault for block in blocks].index(True)
    assert all(Fault.NO_TABLE in block.fault for block in blocks[parted:])


def test_a_leap_of_the_angle_is_no_speed_that_a_trial_has_to_reach() -> None:
    axis = Axis()
    columns = recording(axis, moves(axis, [0.02, 0.02, 0.02]))
    columns[ANGLE][1030:] += 0.6
    blocks = blocks_of(axis, columns)
    assert Fault.TABLE_DISAGREES in faults_of(blocks)
    assert Fault.NO_TABLE not in blocks[-1].fault


def test_a_torque_that_stands_is_reported_until_it_moves_again() -> None:
    axis = Axis()
    columns = recording(axis, moves(axis, SLOW_AND_FAST))
    bad = (columns["time_s"] >= 0.55) & (columns["time_s"] < 0.93)
    torque = columns[TORQUE].copy()
    torque[bad] = torque[bad][0]
    blocks = between(blocks_of(axis, {**columns, TORQUE: torque}), 0.6, 0.9)
    assert all(Fault.TORQUE_STUCK | Fault.STUCK in block.fault for block in blocks)
    assert not any(Fault.NO_TABLE in block.fault for block in blocks)


def test_a_commissioned_machine_is_held_to_its_own_compliance() -> None:
    nominal = channel_limits(Axis().machine)
    # five times a steel screw of 20 mm and 1 m: E A / l with E = 206 GPa
    stiffness = 2.06e11 * np.pi * 0.02**2 / 4.0
    assert nominal.compliance_m_per_n == pytest.approx(5.0 / stiffness, rel=1e-12)
    assert nominal.stretch_m(0.0) == 0.0
    wide = replace(nominal, compliance_m_per_n=2.0 * nominal.compliance_m_per_n)
    assert wide.stretch_m(1.0) == pytest.approx(2.0 * nominal.stretch_m(1.0), rel=1e-12)
