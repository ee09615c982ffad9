"""The axes of the estimator's bench on the library's own plant."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.estimate.commissioning.identification import commissioned
from edge_service.messages import samples
from edge_service.messages.features import FeatureBlock
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import MOTIONS, Dwell, Segment, Setpoints, motion_limits
from edge_service.nodes.stages import make_downsampler

from .scores import Recorded

RATE_HZ = 1000.0
FRAME_ROWS = 10_000
GUIDE_N, BEARING_NM = 60.0, 0.05
FRICTION = ("stribeck:excess_nm=0.08,speed_rad_s=3", "torque_ripple:amplitude_nm=0.01,order=8")
STROKE_MAP = (0.05, 0.03)
"""First and second harmonic of the preload along the stroke, over its mean."""
HIDDEN = (samples.EXTERNAL_FORCE, samples.TEMPERATURE)
TABLE = (samples.TABLE_POSITION, samples.TABLE_SPEED)


@dataclass(frozen=True, slots=True)
class OwnAxis:
    """One axis: drawn from its tolerances, or exactly nominal with seed 0."""

    seed: int = 0
    effects: tuple[str, ...] = ()  # of the true axis beside `FRICTION`
    one_encoder: bool = False  # whether the table has none
    arrangement: str = "fixed-free"
    hanging_n: float = 0.0  # weight less counterweight, along x

    @property
    def fresh_percent(self) -> float:
        return _default().fresh_preload_percent or 0.0

    def frames(
        self,
        motion: str,
        percent: Floats,
        seed: int,
        effects: Sequence[str] = (),
        lubricant: float | Floats = 1.0,
        pauses: Iterable[tuple[float, float]] = (),
        **loads: Floats,
    ) -> Iterator[SampleFrame]:
        """A motion at 1 kHz with the mean preload of each sample (n,).

        Args:
            effects: that come on top.
            lubricant: drag of the nut over that of its preload, everywhere on the stroke, (n,).
            pauses: standstill (at s, for s), beginning with the next segment.
            loads: arguments of `FeedDrive.advance`, (n,).
        """
        limits = motion_limits(_default())
        active = [parse_effect(text) for text in (*FRICTION, *self.effects, *effects)]
        settings = FeedDriveSettings.of_machine(true_machine(self), RATE_HZ, active)
        drive = FeedDrive(settings, limits.low_m, float(percent[0]), seed)
        segments = MOTIONS[motion](limits, np.random.default_rng((seed, 1)))
        setpoints = Setpoints(_pause(segments, pauses), limits.low_m, RATE_HZ)
        hidden = (*HIDDEN, *TABLE) if self.one_encoder else HIDDEN
        force_n = loads.get(samples.EXTERNAL_FORCE, np.zeros(len(percent)))
        loads = {**loads, samples.EXTERNAL_FORCE: force_n + self.hanging_n}
        factor = np.broadcast_to(lubricant, percent.shape)
        for first in range(0, len(percent), FRAME_ROWS):
            rows = slice(first, first + FRAME_ROWS)
            targets = setpoints.take(len(percent[rows]))
            local = percent[rows] * self._stroke_factor(targets[:, 0])
            drag_nm = settings.screw_drag_nm(local * factor[rows])
            acting = {name: load[rows] for name, load in loads.items()}
            frame = drive.advance(targets, local, drag_nm=drag_nm, **acting)
            kept = {name: c for name, c in frame.channels.items() if name not in hidden}
            yield SampleFrame(frame.time_s, kept)

    def _stroke_factor(self, table_m: Floats) -> Floats:
        phases = np.random.default_rng((self.seed, 2)).uniform(0.0, 2.0 * np.pi, 2)
        turn = 2.0 * np.pi * table_m / (_default().axis.stroke_m or 1.0)
        waves = (
            share * np.cos(k * turn + phase)
            for k, (share, phase) in enumerate(zip(STROKE_MAP, phases, strict=True), start=1)
        )
        return np.asarray(1.0 + sum(waves))

    def nominal(self) -> Machine:
        machine = _default()
        inertia = machine.model.inertia_kg_m2.value
        stated = {
            "inertia_kg_m2": Quantity(value=inertia, tolerance=0.05),
            "nut_stiffness_n_per_m": Quantity(value=_nut_stiffness(machine), tolerance=0.1),
            "table_mass_kg": Quantity(value=20.0, tolerance=0.02),
        }
        return machine.model_copy(update={"model": machine.model.model_copy(update=stated)})

    def produced(self, percent: Floats, seed: int, *given: Any, **loads: Any) -> Recorded:
        """Blocks of production (see `frames`) with the mean preload of each sample as truth."""
        frames = self.frames("production", percent, seed, *given, **loads)
        time_s = np.arange(len(percent)) / RATE_HZ
        return Recorded(downsampled(frames, self.nominal()), time_s, percent)

    def commissioned(self) -> Machine:
        """Its machine file after commissioning on a healthy, cold recording."""
        return _commissioned(self)


def _pause(segments: Iterable[Segment], pauses: Iterable[tuple[float, float]]) -> Iterator[Segment]:
    """Segments with standstill (at s, for s) between them."""
    left, at_s = sorted(pauses), 0.0
    for segment in segments:
        while left and at_s >= left[0][0]:
            stop = Dwell(left.pop(0)[1])
            at_s += stop.duration_s
            yield stop
        at_s += segment.duration_s
        yield segment


def downsampled(
    frames: Iterable[SampleFrame], machine: Machine, interval_s: float = 0.1
) -> list[FeatureBlock]:
    downsampler = make_downsampler(machine, interval_s=interval_s)
    return [block for frame in frames for block in downsampler.push(frame)]


@cache
def _default() -> Machine:
    return load_machine(DEFAULT_MACHINE)


def _nut_stiffness(machine: Machine) -> float:
    """0.8 K (F_p / 0.1 C_a)^(1/3) with K = 1.6e8 N/m (5.3.11)."""
    return float(0.8 * 1.6e8 * np.cbrt((machine.fresh_preload_percent or 0.0) / 10.0))


@cache
def true_machine(axis: OwnAxis) -> Machine:
    machine, random = _default(), np.random.default_rng((axis.seed, 3))

    def drawn(value: float, share: float) -> Quantity:
        off = float(np.clip(random.standard_normal(), -2.0, 2.0)) if axis.seed else 0.0
        return Quantity(value=value * (1.0 + share * off))

    model = machine.model
    drag = model.preload_drag_nm
    assert drag is not None
    truth = {
        "inertia_kg_m2": drawn(model.inertia_kg_m2.value, 0.01),
        "viscous_nm_s_per_rad": drawn(model.viscous_nm_s_per_rad.value, 0.05),
        "preload_drag_nm": drawn(drag.value, 0.01),
        "guide_force_n": drawn(GUIDE_N, 0.1),
        "bearing_drag_nm": drawn(BEARING_NM, 0.1),
        "table_mass_kg": drawn(20.0, 0.005),
        "nut_stiffness_n_per_m": drawn(_nut_stiffness(machine), 0.05),
    }
    held = machine.axis.model_copy(update={"bearing_arrangement": axis.arrangement})
    return machine.model_copy(update={"axis": held, "model": model.model_copy(update=truth)})


@cache
def healthy(axis: OwnAxis) -> list[list[FeatureBlock]]:
    """Production and a friction test of the healthy, cold axis."""
    recordings, nominal = [], axis.nominal()
    for number, (motion, duration_s) in enumerate((("production", 60.0), ("friction", 132.0))):
        percent = np.full(round(duration_s * RATE_HZ), axis.fresh_percent)
        recordings.append(downsampled(axis.frames(motion, percent, 11 + number), nominal))
    return recordings


@cache
def _commissioned(axis: OwnAxis) -> Machine:
    return commissioned(healthy(axis), axis.nominal())
