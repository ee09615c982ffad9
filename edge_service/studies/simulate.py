"""`edge-service simulate`: a recording of the simulated axis with any set of effects."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..messages.channels import CHANNELS
from ..models.effects.effect import ActiveEffect
from ..models.effects.registry import parse_effect
from ..models.feed_drive import FeedDrive, FeedDriveSettings
from ..models.machine import Machine
from ..models.motion import MOTIONS, Segment, Setpoints, motion_limits
from ..models.stiffness import CATALOGUE_PRELOAD_PERCENT
from ..trace.writer import TraceWriter

ENDLESS_DURATION_S = 60.0
"""Duration of an endless motion unless one is given."""
_BLOCK_S = 10.0


class SimulationError(Exception):
    """A simulation that cannot be; the text is one line."""


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """What is simulated.

    Attributes:
        motion: name of the commanded motion.
        effects: beyond those of the machine file, each as NAME[:key=value,...].
        duration_s: axis time; the motion's own unless given.
        preload_percent: of the dynamic load rating; the machine file's fresh preload unless given.
        added_mass_kg: weight plates on the table; the drive does not know of them.
        external_force_n: constant force on the table, positive along x; it stands in the record.
        seed: of noise and motion; the same seed gives the same bytes.
    """

    motion: str = "production"
    effects: tuple[str, ...] = ()
    duration_s: float | None = None
    preload_percent: float | None = None
    added_mass_kg: float = 0.0
    external_force_n: float = 0.0
    seed: int = 1
    rate_hz: float = 1000.0


def simulate(
    machine: Machine,
    settings: SimulationSettings,
    out: Path,
    progress: Callable[[str], None] = lambda _line: None,
) -> str:
    """Write the recording to `out`, .csv or .parquet, and return a line that tells what it is.

    Raises:
        SimulationError: an unknown motion or effect, or a number that cannot be.
        TraceError: `out` cannot be written.
    """
    _check_numbers(settings)
    preload_percent = _preload_percent(machine, settings.preload_percent)
    effects = _effects(settings.effects)
    setpoints, count = _commanded(machine, settings)
    try:
        drive_settings = FeedDriveSettings.of_machine(machine, settings.rate_hz, effects)
        home_m = motion_limits(machine).low_m
        drive = FeedDrive(drive_settings, home_m, preload_percent, settings.seed)
    except ValueError as error:
        raise SimulationError(str(error)) from error
    block = round(_BLOCK_S * settings.rate_hz)
    with TraceWriter(out, tuple(CHANNELS)) as writer:
        for done in range(0, count, block):
            rows = min(block, count - done)
            frame = drive.advance(
                setpoints.take(rows),
                np.full(rows, preload_percent),
                external_force_n=np.full(rows, settings.external_force_n),
                added_mass_kg=np.full(rows, settings.added_mass_kg),
            )
            writer.write(frame)
            progress(f"{(done + rows) / settings.rate_hz:.0f} of {count / settings.rate_hz:.0f} s")
    present = ", ".join(each.effect.name for each in drive_settings.effects) or "none"
    return (
        f"{out}: {count} rows, {count / settings.rate_hz:g} s of {settings.motion} "
        f"at {preload_percent:.3g} % preload; effects: {present}"
    )


def _preload_percent(machine: Machine, wanted: float | None) -> float:
    """Preload, %; where the machine file knows none, that of a nut as its catalogue has it."""
    if wanted is None:
        fresh = machine.fresh_preload_percent
        return CATALOGUE_PRELOAD_PERCENT if fresh is None else fresh
    missing = machine.missing_for_percent()
    if missing is not None:
        raise SimulationError(f"preload: {missing} is missing in the machine file")
    if not 0.0 <= wanted <= 100.0:
        raise SimulationError(f"preload: expected 0 to 100 %, got {wanted:g}")
    return wanted


def _effects(texts: Sequence[str]) -> list[ActiveEffect]:
    try:
        return [parse_effect(text) for text in texts]
    except ValueError as error:
        raise SimulationError(str(error)) from error


def _commanded(machine: Machine, settings: SimulationSettings) -> tuple[Setpoints, int]:
    """The motion's setpoints and how many of them are wanted."""
    if settings.motion not in MOTIONS:
        known = ", ".join(sorted(MOTIONS))
        raise SimulationError(f"motion: {settings.motion!r} is none of {known}")
    motion, rate_hz = MOTIONS[settings.motion], settings.rate_hz
    try:
        limits = motion_limits(machine)
        segments: Iterable[Segment] = motion(limits, np.random.default_rng((settings.seed, 1)))
        duration_s = settings.duration_s
        if duration_s is None and motion.duration_s(limits) is None:
            duration_s = ENDLESS_DURATION_S
    except ValueError as error:
        raise SimulationError(str(error)) from error
    if duration_s is not None:
        return Setpoints(iter(segments), limits.low_m, rate_hz), round(duration_s * rate_hz)
    segments = tuple(segments)
    count = sum(math.ceil(segment.duration_s * rate_hz) for segment in segments)
    return Setpoints(iter(segments), limits.low_m, rate_hz), count


def _check_numbers(settings: SimulationSettings) -> None:
    if not 0.0 <= settings.added_mass_kg < math.inf:
        raise SimulationError(f"added mass: expected 0 kg or more, got {settings.added_mass_kg:g}")
    if not math.isfinite(settings.external_force_n):
        raise SimulationError(f"external force: expected newtons, got {settings.external_force_n}")
    duration_s = settings.duration_s
    if duration_s is not None and not 1.0 / settings.rate_hz <= duration_s < math.inf:
        raise SimulationError(f"duration: expected a sample or more, got {duration_s:g} s")
