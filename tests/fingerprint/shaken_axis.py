"""An axis that is shaken on a slow feed, step by step; shares no equation with the library."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from edge_service.messages.samples import ANGLE, SETPOINT, TORQUE, SampleFrame

Array = NDArray[np.float64]
START_M, FEED_M_S, SWEEP_S, NOISE_NM = 0.2, 0.02, 20.0, 0.003
STEP_S = 2.5e-5
TICKS = 5
"""Steps between two samples of the drive's controller."""


@dataclass(frozen=True)
class Axis:
    """Motor, screw and table; a nut of two opposed contacts F ~ d^n; SI units."""

    inertia_kg_m2: float = 1.5e-3
    table_kg: float = 60.0
    lead_m: float = 0.02
    antiresonance_hz: float = 98.0
    share: float = 0.25  # of the nut in the compliance, fresh
    contact: float = 1.5
    preload_n: float = 2000.0
    preload: float = 1.0
    softer: float = 1.0  # compliance of the rest over that at first
    payload_kg: float = 0.0
    hanging_n: float = 0.0
    nut_nm: float = 0.2
    guide_n: float = 60.0
    guide_m: float = 8e-6
    damping: float = 0.03
    friction: float = 1.0
    torque_factor: float = 1.0
    # base_hz, base_kg: a machine bed under the table; no bed without a mass
    base_hz: float = 0.0
    base_kg: float = 0.0
    delay_s: float = 5e-4  # of the recorded angle after the recorded torque
    feedforward: bool = True

    @property
    def radius_m(self) -> float:
        return self.lead_m / (2.0 * math.pi)

    @property
    def fresh_n_per_m(self) -> float:
        return self.table_kg * (2.0 * math.pi * self.antiresonance_hz) ** 2

    def stiffness(self) -> float:
        """Stiffness of all in series, N/m, under the standing force."""
        nut = self.share / self.fresh_n_per_m * self._nut() / Axis(contact=self.contact)._nut()
        return 1.0 / ((1.0 - self.share) / self.fresh_n_per_m * self.softer + nut)

    def _nut(self) -> float:
        """Compliance of the nut in units of its own."""
        n, q = self.contact, self.preload ** (1.0 / self.contact)
        load = self.hanging_n / self.preload_n

        def force(y: float) -> float:
            return float(max(q + y, 0.0) ** n - max(q - y, 0.0) ** n - load)

        y = float(optimize.brentq(force, -3.0, 3.0))
        return 1.0 / float(n * (max(q + y, 1e-3) ** (n - 1.0) + max(q - y, 0.0) ** (n - 1.0)))


def shaken(axis: Axis, seed: int, rate_hz: float = 1000.0, **how: float) -> SampleFrame:
    """Torque, motor angle and set point of a sweep each way, at a rate."""
    return driven(axis, sweeps(rate_hz, **how), seed, rate_hz)


def sweeps(rate_hz: float = 1000.0, feed_m_s: float = FEED_M_S, speed_share: float = 0.8) -> Array:
    """Speed in each step of a sweep each way."""
    rest, ramp = np.zeros(round(0.5 / STEP_S)), np.linspace(0.0, 1.0, round(0.1 / STEP_S))
    t = np.arange(round(SWEEP_S / STEP_S)) * STEP_S
    high = min(300.0, 0.45 * rate_hz)
    hz = 5.0 * (high / 5.0) ** (t / SWEEP_S)
    fade = np.clip(np.minimum(t, SWEEP_S - t) / 0.5, 0.0, 1.0)
    size = np.minimum(speed_share * max(feed_m_s, FEED_M_S), 2.0 / (2.0 * np.pi * hz)) * fade
    wave = size * np.sin(2.0 * np.pi * np.cumsum(hz) * STEP_S)
    way = np.concatenate((rest, ramp * feed_m_s, feed_m_s + wave, ramp[::-1] * feed_m_s))
    return np.concatenate((way, -way, rest))


def smooth(speeds_m_s: Sequence[float]) -> Array:
    """Speed in each step where one after the other is held for a second, without a jump."""
    speed = np.repeat(speeds_m_s, round(1.0 / STEP_S))
    return np.convolve(speed, np.full(8000, 1.0 / 8000.0), mode="same")


def driven(axis: Axis, speed_m_s: Array, seed: int, rate_hz: float = 1000.0) -> SampleFrame:
    """Torque, motor angle and set point of an axis that is told a speed each step."""
    random = np.random.default_rng(seed)
    masses = (axis.inertia_kg_m2, axis.table_kg + axis.payload_kg, axis.base_kg)
    stiffness = axis.stiffness()
    base = axis.base_kg * (2.0 * math.pi * axis.base_hz) ** 2
    whole = axis.inertia_kg_m2 + axis.table_kg * axis.radius_m**2
    damping = 2.0 * axis.damping * math.sqrt(axis.fresh_n_per_m * axis.table_kg)
    nut_nm = axis.nut_nm * axis.preload * axis.friction
    torque, angle = _run(
        speed_m_s / axis.radius_m,
        masses,
        (stiffness, damping, base, 0.02 * math.sqrt(max(base * axis.base_kg, 0.0)) * 2.0),
        (nut_nm, axis.guide_n * axis.friction, axis.guide_m, axis.hanging_n),
        axis.radius_m,
        whole,
        float(axis.feedforward),
        NOISE_NM * random.standard_normal(len(speed_m_s) // TICKS + 1),
    )
    every = round(1.0 / rate_hz / STEP_S)
    late = round(axis.delay_s / STEP_S)
    at = np.arange(late, len(speed_m_s), every)
    seen = angle[at - late if late else at] + START_M / axis.radius_m
    place = START_M + np.cumsum(speed_m_s) * STEP_S
    channels = {
        TORQUE: np.round(torque[at] * axis.torque_factor / 0.004) * 0.004,
        ANGLE: np.round(seen * 2.0**20 / 2.0 / np.pi) * 2.0 * np.pi / 2.0**20,
        SETPOINT: place[at],
    }
    return SampleFrame(np.arange(len(at)) / rate_hz, channels)


@numba.njit(cache=True)
def _run(
    speed: Array,
    masses: tuple[float, float, float],
    springs: tuple[float, float, float, float],
    friction: tuple[float, float, float, float],
    radius: float,
    whole: float,
    forward: float,
    noise: Array,
) -> tuple[Array, Array]:
    """Torque command and angle of each step: P-PI controller, loop of 300 Hz, Dahl's guide."""
    inertia, table, bed = masses
    stiffness, damping, bed_stiffness, bed_damping = springs
    nut, guide, guide_m, hanging = friction
    n = len(speed)
    torques, angles = np.empty(n), np.empty(n)
    angle, turn, x, v, z, b, u = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    x = -hanging / stiffness
    command, current, integral, wanted, told, last = hanging * radius, 0.0, 0.0, 0.0, 0.0, 0.0
    current = command
    gain = whole * 2.0 * math.pi * 40.0
    tick = TICKS * STEP_S
    for k in range(n):
        wanted += speed[k] * STEP_S
        if k % TICKS == 0:
            aim = forward * speed[k] + 40.0 * (wanted - angle)
            error = aim - turn
            integral += error * tick * 2.0 * math.pi * 6.0
            told = gain * (error + integral) + hanging * radius
            told += forward * whole * (speed[k] - last) / tick
            last = speed[k]
            command = told + noise[k // TICKS]
        current += (command - current) * 2.0 * math.pi * 300.0 * STEP_S
        spring = stiffness * (radius * angle + b - x) + damping * (radius * turn + u - v)
        drag = nut * math.tanh(turn / 0.02)
        z += (v - u) * STEP_S * (1.0 - z / guide_m * (1.0 if v > u else -1.0))
        slip = guide * z / guide_m
        turn += (current - drag - radius * spring) / inertia * STEP_S
        angle += turn * STEP_S
        v += (spring - slip - hanging) / table * STEP_S
        x += v * STEP_S
        if bed > 0.0:
            u += (slip - spring - bed_stiffness * b - bed_damping * u) / bed * STEP_S
            b += u * STEP_S
        torques[k], angles[k] = command, angle
    return torques, angles
