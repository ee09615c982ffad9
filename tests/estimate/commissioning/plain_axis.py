"""An axis of any size as plain sums: J a + D v + C sgn v + G, and one spring to the table."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine


@dataclass(frozen=True)
class PlainAxis:
    """Parameters of the axis, its motion and its sampling."""

    lead_m: float = 0.02
    table_kg: float = 20.0
    rotor_kg_m2: float = 1.3e-3
    viscous_nm_s: float = 5e-3
    screw_nm: float = 0.146  # the fresh screw's own drag, beside which are guides and bearings
    bearing_nm: float = 0.05
    guide_n: float = 60.0
    hanging_nm: float = 0.0  # torque that holds the table, whichever way it moves
    chain_nm: float = 0.0  # by which that torque grows from one end of the stroke to the other
    stiffness_n_per_m: float = 3e7
    nut_n_per_m: float = 1e8
    stroke_m: float = 0.8
    top_rad_s: float = 150.0
    acceleration_rad_s2: float = 400.0
    rate_hz: float = 1000.0
    quantum_nm: float = 0.0  # step of the torque channel; 0 for none
    encoder_rad: float = 1e-6
    late_s: float = 0.0  # by which the torque channel lags
    one_encoder: bool = False  # whether the table has none

    @property
    def ratio_m(self) -> float:
        return self.lead_m / (2.0 * np.pi)

    @property
    def inertia_kg_m2(self) -> float:
        return self.rotor_kg_m2 + self.table_kg * self.ratio_m**2

    @property
    def coulomb_nm(self) -> float:
        return self.screw_nm + self.bearing_nm + self.guide_n * self.ratio_m

    def machine(self, **stated: float) -> Machine:
        """Nominal machine file; `stated` replaces numbers of its model."""
        model = {
            "inertia_kg_m2": {"value": self.inertia_kg_m2, "tolerance": 0.05},
            "preload_drag_nm": self.screw_nm,
            "preload_n": 500.0,
            "table_mass_kg": {"value": self.table_kg, "tolerance": 0.02},
            "nut_stiffness_n_per_m": {"value": self.nut_n_per_m, "tolerance": 0.1},
        }
        axis = {"lead_m": self.lead_m, "stroke_m": self.stroke_m, "dynamic_load_rating_n": 7450.0}
        return Machine.model_validate({"axis": axis, "model": model | stated})

    def frame(
        self, shares: Sequence[float] = (0.1, 0.2, 0.4, 0.7, 1.0), laps: int = 2
    ) -> SampleFrame:
        """Moves to and fro at shares of the top speed, all samples at once."""
        speed = np.concatenate(
            [self._move(share, way) for _ in range(laps) for share in shares for way in (1.0, -1.0)]
        )
        step_s, after = 1.0 / self.rate_hz, np.append(speed[1:], 0.0)
        mean, acceleration = 0.5 * (speed + after), (after - speed) / step_s
        torque = self.inertia_kg_m2 * acceleration + self.viscous_nm_s * mean
        torque += self.coulomb_nm * np.sign(mean) + self.hanging_nm
        travel = np.concatenate([[0.0], np.cumsum(mean[:-1]) * step_s])
        torque += self.chain_nm * self.ratio_m * travel / self.stroke_m
        return self._sampled(torque, travel, np.append(0.0, acceleration[:-1]), np.sign(mean))

    def _move(self, share: float, way: float) -> Floats:
        top = share * self.top_rad_s
        ramp = np.linspace(0.0, top, max(round(self.rate_hz * top / self.acceleration_rad_s2), 2))
        rows = round(min(0.7 * self.stroke_m / self.ratio_m / top, 1.0) * self.rate_hz)
        trapezoid = np.concatenate([ramp, np.full(rows, top), ramp[::-1]])
        width = round(0.02 * self.rate_hz)
        smooth = np.convolve(trapezoid, np.ones(width) / width)
        return np.asarray(way * np.concatenate([smooth, np.zeros(round(0.2 * self.rate_hz))]))

    def _sampled(
        self, torque: Floats, travel: Floats, acceleration: Floats, sign: Floats
    ) -> SampleFrame:
        rng = np.random.default_rng(5)
        noise, level = rng.standard_normal((3, len(travel))), 0.01 * self.coulomb_nm
        torque = np.roll(torque, round(self.late_s * self.rate_hz)) + level * noise[0]
        if self.quantum_nm:
            torque = self.quantum_nm * np.round(torque / self.quantum_nm)
        pull_n = self.table_kg * self.ratio_m * acceleration + self.guide_n * sign
        table = 0.1 * self.stroke_m + self.ratio_m * travel - pull_n / self.stiffness_n_per_m
        angle = travel + self.encoder_rad * noise[1]
        channels = {TORQUE: torque, ANGLE: angle, TABLE_POSITION: table + 5e-8 * noise[2]}
        if self.one_encoder:
            del channels[TABLE_POSITION]
        return SampleFrame(np.arange(len(travel)) / self.rate_hz, channels)
