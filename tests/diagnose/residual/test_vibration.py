"""Vibrations are found and named; lines that the motion repeats are not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from edge_service.diagnose.pipeline import diagnose_session, learnable
from edge_service.diagnose.residual.noise import Noise
from edge_service.diagnose.residual.vibration import strongest_vibration
from edge_service.diagnose.result import VIBRATION, Verdict
from edge_service.diagnose.session.session import TORQUE_GAP, Session
from edge_service.messages.samples import Floats
from edge_service.models.effects.baseline import Motion
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, session_of

TORQUE = "torque_command_nm"


def shaken(machine: Machine, curve: Callable[[Floats], Floats], seed: int = 3) -> Session:
    """A healthy recording with a torque over time, N m, added."""
    recording = recorded((), seed)
    added = curve(recording.columns["time_s"])
    return session_of(machine, frame_of(recording, **{TORQUE: recording.columns[TORQUE] + added}))


def wandering(time_s: Floats) -> Floats:
    """An oscillation whose phase wanders: a band of 0.3 Hz."""
    steps = np.random.default_rng(1).normal(0.0, np.sqrt(2e-3 * np.pi * 0.3), len(time_s))
    return 0.08 * np.sin(2.0 * np.pi * 7.3 * time_s + np.cumsum(steps))


@pytest.mark.parametrize("frequency_hz", [1.3, 7.3, 23.0])
def test_a_line_is_found_as_strong_as_it_is(machine: Machine, frequency_hz: float) -> None:
    session = shaken(machine, lambda t: 0.08 * np.sin(2.0 * np.pi * frequency_hz * t))
    found = strongest_vibration(session, machine)
    assert found and found.frequency_hz == pytest.approx(frequency_hz, abs=0.005)
    assert found.amplitude == pytest.approx(0.08, rel=0.05)
    calm = session_of(machine, frame_of(recorded((), 3)))
    left = found.taken_from(session).channels[TORQUE_GAP].rms
    assert left == pytest.approx(calm.channels[TORQUE_GAP].rms, rel=0.05)
    assert strongest_vibration(found.taken_from(session), machine) is None


def test_a_band_and_a_burst_are_found_where_they_are(machine: Machine) -> None:
    band = strongest_vibration(shaken(machine, wandering), machine)
    assert band and band.frequency_hz == pytest.approx(7.3, abs=0.3)
    session = shaken(machine, lambda t: np.where(t > 20.0, 0.15 * np.sin(94.0 * t), 0.0))
    burst = strongest_vibration(session, machine)
    assert burst and burst.frequency_hz == pytest.approx(94.0 / 2.0 / np.pi, abs=0.1)


@pytest.mark.parametrize("seed", [3, 4, 5, 6])
def test_a_healthy_axis_does_not_vibrate(machine: Machine, seed: int) -> None:
    assert strongest_vibration(session_of(machine, frame_of(recorded((), seed))), machine) is None


FOLLOWING: dict[str, Callable[[Motion], Floats]] = {
    "angle": lambda motion: 0.08 * np.sin(5.3 * motion.angle_rad),
    "angle, turned": lambda motion: 0.08 * motion.direction * np.sin(7.0 * motion.angle_rad),
    "reversals": lambda motion: 0.1 * np.exp(-np.abs(motion.speed_rad_s)) * motion.direction,
}


@pytest.mark.parametrize("name", FOLLOWING)
def test_what_follows_the_motion_is_no_vibration(machine: Machine, name: str) -> None:
    session = session_of(machine, frame_of(recorded((), 3)))
    rows = session.channels[TORQUE_GAP]
    gap = rows.gap + session.column(TORQUE_GAP, FOLLOWING[name])
    moved = replace(session, channels={TORQUE_GAP: replace(rows, gap=gap)})
    assert strongest_vibration(moved, machine) is None


def test_a_reference_bounds_the_floor_from_both_sides(machine: Machine) -> None:
    session = shaken(machine, lambda t: 0.08 * np.sin(2.0 * np.pi * 7.3 * t))
    beside = replace(session, healthy_floor={TORQUE_GAP: 0.011})
    assert Noise.of_gap(session, machine).floor[TORQUE_GAP] > 0.04
    assert Noise.of_gap(beside, machine).floor[TORQUE_GAP] == 0.011


@pytest.mark.slow
def test_a_vibration_is_named_beside_another_cause(machine: Machine) -> None:
    recording = recorded(("load_offset",), 3)
    hum = 0.06 * np.sin(2.0 * np.pi * 11.0 * recording.columns["time_s"])
    frame = frame_of(recording, **{TORQUE: recording.columns[TORQUE] + hum})
    session = session_of(machine, frame)
    found = diagnose_session(session, machine)
    assert found.verdict is Verdict.EXPLAINED
    assert [each.name for each in found.effects] == ["load_offset", VIBRATION]
    assert [each.name for each in learnable(found, session)] == ["load_offset"]
    shaking = found.effects[1]
    assert shaking.parameters["frequency_hz"].value == pytest.approx(11.0, abs=0.01)
    assert shaking.entries == ()
    assert shaking.shrink.estimate == 0.0 < shaking.shrink.high


@pytest.mark.slow
def test_teeth_that_cut_are_told_beside_their_force(machine: Machine) -> None:
    session = session_of(machine, frame_of(recorded(("external_force",), 11)))
    found = diagnose_session(session, machine)
    assert [each.name for each in found.effects] == ["external_force"]
