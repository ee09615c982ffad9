"""The plant with an effect differs from the plant without it as the effect's signatures say."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.messages import samples as channels
from edge_service.messages.samples import Floats
from edge_service.models.effects.baseline import Baseline, Motion
from edge_service.models.effects.registry import effect_names, parse_effect
from edge_service.models.effects.signature import torque_signature, transmission_signature
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import Dwell, Move, Setpoints
from edge_service.models.plant.closed_loop import Sensors

IDEAL = Sensors(*[0.0] * len(Sensors._fields))
HOME_M, RATE_HZ = 0.2, 1000.0
MOVES = (
    Move(0.3, 0.25, 3.0, 200.0),
    Move(-0.3, 0.1, 2.0, 200.0),
    Move(0.02, 0.01, 2.0, 200.0),
    Move(-0.02, 0.01, 2.0, 200.0),
    Move(0.4, 0.5, 4.0, 200.0),
    Move(-0.4, 0.3, 4.0, 200.0),
)
GUIDE_N = 300.0
"""Greater than the inertia force of the table: backlash stays on the flank of the direction."""
TORQUE_FLOOR_NM, TRANSMISSION_FLOOR_M = 1.5e-3, 60e-9
"""Difference of two runs of almost the same motion, far below any sensor's noise."""


@dataclass(frozen=True)
class Run:
    """One run: motion, and what the baseline leaves of torque and of x - R theta, (n,) each."""

    motion: Motion
    torque_nm: Floats
    transmission_m: Floats


def smooth(values: Floats) -> Floats:
    """Zero phase, 30 Hz: below the resonance and above all that the moves excite."""
    result: Floats = filtfilt(*butter(4, 30.0, fs=RATE_HZ), values)
    return result


def machine() -> Machine:
    bench = load_machine(DEFAULT_MACHINE)
    known = {"guide_force_n": Quantity(value=GUIDE_N), "table_mass_kg": Quantity(value=30.0)}
    return bench.model_copy(update={"model": bench.model.model_copy(update=known)})


BASELINE = Baseline.of_machine(machine())


@cache
def run(*effects: str, warmest_c: float = 20.0) -> Run:
    settings = FeedDriveSettings.of_machine(
        machine(), RATE_HZ, [parse_effect(text) for text in effects]
    )
    segments = [segment for move in MOVES for segment in (move, Dwell(0.3))]
    count = int(RATE_HZ * sum(segment.duration_s for segment in segments))
    setpoints = Setpoints(iter(segments), HOME_M, RATE_HZ).take(count)
    percent = machine().fresh_preload_percent or 0.0
    drive = FeedDrive(replace(settings, sensors=IDEAL), HOME_M, percent, seed=1)
    temperature_c = np.linspace(20.0, warmest_c, count)
    frame = drive.advance(setpoints, np.full(count, percent), temperature_c=temperature_c)
    angle, table = frame.channels[channels.ANGLE], frame.channels[channels.TABLE_POSITION]
    speed = np.gradient(angle, frame.time_s)
    held = frame.channels[channels.TORQUE]
    torque = np.concatenate((held[:1], 0.5 * (held[1:] + held[:-1])))  # held for a period each
    motion = Motion.of_samples(
        BASELINE,
        frame.time_s,
        angle,
        speed,
        np.gradient(speed, frame.time_s),
        position_m=table,
        torque_nm=torque,
        temperature_c=temperature_c,
        still_rad_s=1e-3,
    )
    carried_nm = motion.load_torque_nm + BASELINE.table_coulomb_nm * motion.direction
    wound = BASELINE.wind_up_m(carried_nm, table)
    stretch = table - BASELINE.ratio_m_per_rad * angle - wound
    return Run(motion, torque - motion.model_torque_nm, stretch)


def settled(motion: Motion) -> Floats:
    """Rows around which the axis moves in one direction for 0.1 s either way, (n,)."""
    turning = (np.abs(motion.speed_rad_s) < 0.5).astype(np.float64)
    return np.convolve(turning, np.ones(201), "same") < 0.5


def spread(values: Floats, chosen: Floats) -> float:
    """Root mean square without the constant, which x - R theta leaves open."""
    return float(np.std(values[chosen]))


AS_USUAL = [(name, {}) for name in effect_names()]
WARMER = {"warmest_c": 30.0}
THINNED = [
    "warmup:thinned_nm=0.1,reference_c=22,span_k=9",
    "warmup:thinned_nm_s_per_rad=0.004,reference_c=22,span_k=9",
    "warmup:viscous_excess_nm_s_per_rad=0.004,time_constant_s=20",
]
GROWN = "thermal_growth:strain_per_k=1e-5,reference_c=22"


@pytest.mark.parametrize(("name", "warmth"), AS_USUAL + [(name, WARMER) for name in THINNED])
def test_torque_differs_as_its_signature_says(name: str, warmth: dict[str, float]) -> None:
    active, plain, changed = parse_effect(name), run(**warmth), run(name, **warmth)
    expected = smooth(torque_signature(active.effect, active.values, changed.motion, BASELINE))
    found = smooth(changed.torque_nm) - smooth(plain.torque_nm)
    chosen = settled(changed.motion)
    error_nm = np.sqrt(np.mean((found - expected)[chosen] ** 2))
    size_nm = np.sqrt(np.mean(expected[chosen] ** 2))
    assert not warmth or size_nm > 10.0 * TORQUE_FLOOR_NM
    assert error_nm < TORQUE_FLOOR_NM + 0.01 * size_nm


@pytest.mark.parametrize(("name", "warmth"), [*AS_USUAL, (GROWN, WARMER)])
def test_transmission_differs_as_its_signature_says(name: str, warmth: dict[str, float]) -> None:
    active, plain, changed = parse_effect(name), run(**warmth), run(name, **warmth)
    signature = transmission_signature(active.effect, active.values, changed.motion, BASELINE)
    found = smooth(changed.transmission_m) - smooth(plain.transmission_m)
    chosen = settled(changed.motion)
    assert not warmth or spread(signature, chosen) > 50.0 * TRANSMISSION_FLOOR_M
    error_m = spread(found - smooth(signature), chosen)
    assert error_m < TRANSMISSION_FLOOR_M + 0.01 * spread(signature, chosen)


FELT_IN_TORQUE = set(effect_names()) - {
    *("backlash", "compliance", "lead_error", "presliding", "thermal_growth", "timestamp_skew")
}
SEEN_IN_TRANSMISSION = {
    *("backlash", "compliance", "drag_error", "encoder_eccentricity", "external_force"),
    *("inertia_error", "lead_error", "position_friction", "thermal_growth", "timestamp_skew"),
}


@pytest.mark.parametrize("name", sorted(FELT_IN_TORQUE))
def test_a_typical_fault_is_felt_in_the_torque(name: str) -> None:
    changed = run(name)
    difference = smooth(changed.torque_nm) - smooth(run().torque_nm)
    size_nm = np.sqrt(np.mean(difference[settled(changed.motion)] ** 2))
    assert size_nm > 3.0 * TORQUE_FLOOR_NM


@pytest.mark.parametrize("name", sorted(SEEN_IN_TRANSMISSION))
def test_a_typical_fault_is_seen_in_the_transmission(name: str) -> None:
    changed = run(name)
    difference = smooth(changed.transmission_m) - smooth(run().transmission_m)
    assert spread(difference, settled(changed.motion)) > 2.5 * TRANSMISSION_FLOOR_M


def test_signatures_of_several_effects_add_up() -> None:
    names = ("stribeck", "torque_ripple", "lead_error", "backlash", "viscous_error")
    changed, plain = run(*names), run()
    torque, transmission = np.zeros((2, len(changed.motion)))
    for name in names:
        active = parse_effect(name)
        torque += torque_signature(active.effect, active.values, changed.motion, BASELINE)
        transmission += transmission_signature(
            active.effect, active.values, changed.motion, BASELINE
        )
    chosen = settled(changed.motion)
    found = smooth(changed.torque_nm) - smooth(plain.torque_nm)
    assert np.std((found - smooth(torque))[chosen]) < 2.0 * TORQUE_FLOOR_NM
    shift = smooth(changed.transmission_m) - smooth(plain.transmission_m)
    assert spread(shift - smooth(transmission), chosen) < 2.0 * TRANSMISSION_FLOOR_M


def test_without_a_temperature_nothing_follows_it() -> None:
    active = parse_effect(THINNED[0])
    motion = run().motion
    unknown = replace(motion, temperature_c=np.full(len(motion), np.nan))
    assert not torque_signature(active.effect, active.values, unknown, BASELINE).any()


def test_a_table_that_viscous_friction_holds_stays_on_its_flank() -> None:
    """The more friction brakes the table itself, the later it leans on the other flank."""
    motion = run().motion
    effects = [
        parse_effect(f"backlash:width_m=2e-5,friction_share=1e-6,viscous_share={share}")
        for share in (0.0, 1.5)
    ]
    loose, held = (
        transmission_signature(each.effect, each.values, motion, BASELINE) for each in effects
    )
    braking = motion.acceleration_rad_s2 * motion.direction < -20.0
    fast = np.abs(motion.speed_rad_s) > 20.0
    assert np.mean((loose != held)[braking & fast]) > 0.05
    assert np.mean((loose != held)[~braking & settled(motion)]) < 0.01
