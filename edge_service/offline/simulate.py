"""`edge-service simulate`: recordings of the simulated axis with any set of effects."""

import contextlib
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..command_answer import Answer, progress
from ..diagnose.preload import fresh_screw
from ..exit_status import BadInputError
from ..messages.samples import CHANNELS, Floats
from ..models.effects.library.external_force import PROCESSES, force_profile, process_force
from ..models.effects.registry import parse_effect
from ..models.feed_drive import FeedDrive, FeedDriveSettings
from ..models.machine import Machine
from ..models.motions.registry import (
    MOTIONS,
    Dwell,
    MotionError,
    MotionLimits,
    Move,
    Setpoints,
    motion_limits,
)
from ..models.motions.route import samples_of
from ..models.screw.nut_law import CATALOGUE_PRELOAD_PERCENT
from ..recordings.columns import TraceError
from ..recordings.writer import TraceWriter

ENDLESS_DURATION_S = 60.0
"""Duration of an endless motion unless one is given."""
LONGEST_S = 1e6
"""Longest duration that a slip of the pen does not explain."""
_HOME_REST_S = 0.2
_AT_HOME_M = 1e-9  # sums of distances are not exact
_BLOCK_S = 10.0
_NUMBERED = re.compile(r"[0-9]{2,}_.+\.(csv|parquet|mcap)")


class SimulationError(BadInputError):
    """A simulation that cannot be; the text is one line."""


@dataclass(frozen=True, slots=True, eq=False)
class CommandedMotion:
    """One motion from home on: its name, its setpoints and how many of them are wanted."""

    name: str
    setpoints: Setpoints
    count: int


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    motion: str = "production"  # name of the commanded motion, or NAME:duration_s=SECONDS
    # beyond those of the machine file, each as NAME[:key=value,...]; payload:mass_kg=20 is weight
    # on the table that the drive does not know of, milling:force_n=-500, drilling:force_n=-500 and
    # external_force:file=f.csv (time_s, force_n) are forces along x that stand in the record
    effects: tuple[str, ...] = ()
    duration_s: float | None = None  # axis time; the motion's own unless given
    # of the dynamic load rating; the machine file's fresh preload unless given
    preload_percent: float | None = None
    seed: int = 1  # of noise and motion; the same seed gives the same bytes
    rate_hz: float = 1000.0


def simulate(machine: Machine, settings: SimulationSettings, out: Path) -> Answer:
    """Write the recording to `out`, .csv or .parquet. Raises SimulationError, TraceError."""
    axis = _Axis(machine, settings)
    commanded = axis.commanded(1, settings.motion, settings.duration_s)
    return axis.recorded([commanded], [out])


def simulate_session(
    machine: Machine, settings: SimulationSettings, motions: Sequence[str], out: Path
) -> Answer:
    """Run motions one after another on one axis, each into a file of the folder `out`.

    Warm-up, clock and noise carry on from file to file, as in a session at a machine; each motion
    begins and ends at rest at home. The files are called 01_friction.parquet, 02_warmup.parquet,
    ..., and appear once all are recorded.

    Raises SimulationError, TraceError.
    """
    axis = _Axis(machine, settings)
    session = [axis.commanded(k, motion, returns=True) for k, motion in enumerate(motions, 1)]
    return axis.recorded(session, _numbered(out, [each.name for each in session]))


class _Axis:
    """The simulated axis, at home, under the conditions of the settings."""

    def __init__(self, machine: Machine, settings: SimulationSettings) -> None:
        self._settings = settings
        wanted, missing = settings.preload_percent, machine.missing_for_percent()
        if wanted is not None and missing is not None:
            raise SimulationError(f"preload: {missing} is missing in the machine file")
        if not 0.0 <= (wanted or 0.0) <= 100.0:
            raise SimulationError(f"preload: expected 0 to 100 %, got {wanted:g}")
        fresh = machine.fresh_preload_percent  # else that of a nut as its catalogue has it
        fresh = CATALOGUE_PRELOAD_PERCENT if fresh is None else fresh
        self._preload_percent = fresh if wanted is None else wanted
        self._load_kg, self._force = 0.0, np.zeros((2, 1))
        self._cuts, names = list[tuple[str, float]](), []
        for text in settings.effects:
            if text.startswith("payload:"):
                self._load_kg += _number(text, "mass_kg", "KILOGRAMS", 0.0)
            elif text.startswith("external_force:file="):
                self._force = _force(Path(text.partition("=")[2]))
            elif text.partition(":")[0] in PROCESSES:
                mean_n = _number(text, "force_n", "NEWTONS", -math.inf)
                self._cuts.append((text.partition(":")[0], mean_n))
            else:
                names.append(text)
        try:
            effects = [parse_effect(text, fresh_screw(machine)) for text in names]
            of_drive = FeedDriveSettings.of_machine(machine, settings.rate_hz, effects)
            self._limits = motion_limits(machine)
            low_m, percent = self._limits.low_m, self._preload_percent
            self._drive = FeedDrive(of_drive, low_m, percent, settings.seed)
        except ValueError as error:
            raise SimulationError(str(error)) from error

    def commanded(
        self, number: int, motion: str, duration_s: float | None = None, *, returns: bool = False
    ) -> CommandedMotion:
        """The motion of this number, from 1 on. Raises SimulationError."""
        random = np.random.default_rng((self._settings.seed, number))
        rate_hz = self._settings.rate_hz
        try:
            wish = parse_motion(motion, duration_s)
            return commanded_motion(*wish, self._limits, rate_hz, random, returns=returns)
        except ValueError as error:
            raise SimulationError(str(error)) from error

    def recorded(self, session: Sequence[CommandedMotion], paths: Sequence[Path]) -> Answer:
        """Run motions one after another and write what the drive reports."""
        recordings, lines, first = [], [], 0
        effects = [each.effect.name for each in self._drive.settings.effects]
        named = ", ".join(effects) or "none"
        with contextlib.ExitStack() as files:
            writers = [files.enter_context(TraceWriter(path, tuple(CHANNELS))) for path in paths]
            for commanded, writer, path in zip(session, writers, paths, strict=True):
                rate_hz, count = self._settings.rate_hz, commanded.count
                block = round(_BLOCK_S * rate_hz)
                for done in range(0, count, block):
                    rows = min(block, count - done)
                    time_s = (first + done + np.arange(rows)) / rate_hz
                    frame = self._drive.advance(
                        commanded.setpoints.take(rows),
                        np.full(rows, self._preload_percent),
                        external_force_n=self._force_n(time_s),
                        added_mass_kg=np.full(rows, self._load_kg),
                    )
                    writer.write(frame)
                    progress(f"recording {commanded.name}: {100 * (done + rows) // count} %")
                first += commanded.count
                duration_s = commanded.count / self._settings.rate_hz
                lines.append(
                    f"{path}: {commanded.count} rows, {duration_s:g} s of {commanded.name} at "
                    f"{self._preload_percent:.3g} % preload; effects: {named}"
                )
                recording = {"out": str(path), "rows": commanded.count, "duration_s": duration_s}
                recording |= {"motion": commanded.name, "preload_percent": self._preload_percent}
                recordings.append(recording | {"effects": effects})
        return Answer("\n".join(lines), {"recordings": recordings})

    def _force_n(self, time_s: Floats) -> Floats:
        """Force of the file and of the processes at times (n,), N."""
        of_file = np.interp(time_s, self._force[0], self._force[1], left=0.0, right=0.0)
        return sum((process_force(*each, time_s) for each in self._cuts), np.asarray(of_file))


def parse_motion(text: str, duration_s: float | None = None) -> tuple[str, float | None]:
    """Name and duration of NAME or NAME:duration_s=SECONDS; `duration_s` where it says none.

    Raises MotionError: no such motion, or no such duration.

    >>> parse_motion("warmup:duration_s=300")
    ('warmup', 300.0)
    """
    name, _, rest = text.partition(":")
    if name not in MOTIONS:
        raise MotionError(f"motion: {name!r} is not one of {', '.join(sorted(MOTIONS))}")
    if rest:
        key, _, number = rest.partition("=")
        if duration_s is not None:
            raise MotionError(f"motion {name}: has two durations; expected one")
        if key.strip() != "duration_s":
            raise MotionError(f"motion {name}: {rest!r}, expected duration_s=SECONDS")
        try:
            duration_s = float(number)
        except ValueError:
            raise MotionError(f"motion {name}: duration_s: {number!r} is no number") from None
    if duration_s is not None and not 0.0 < duration_s <= LONGEST_S:
        expected = f"above 0 s, {LONGEST_S:g} s at most"
        raise MotionError(f"duration: expected a time {expected}, got {duration_s:g} s")
    return name, duration_s


def commanded_motion(
    name: str,
    duration_s: float | None,
    limits: MotionLimits,
    rate_hz: float,
    random: np.random.Generator,
    *,
    returns: bool = False,
) -> CommandedMotion:
    """The motion to its end, or for a duration and then no longer, even within a move.

    Args:
        returns: in whole moves, and then the way home, so that another can follow.

    Raises MotionError: the axis does not allow it, or it takes longer than the duration.
    """
    motion = MOTIONS[name]
    if duration_s is None and motion.duration_s(limits) is None:
        duration_s = ENDLESS_DURATION_S
    if duration_s is not None and not returns:
        count = max(round(duration_s * rate_hz), 1)
        setpoints = Setpoints(motion(limits, random), limits.low_m, rate_hz)
        return CommandedMotion(name, setpoints, count)
    if returns:
        segments = list(motion.plan(limits, random, duration_s=duration_s).segments)
        away_m = sum(segment.distance_m for segment in segments)
        if abs(away_m) > _AT_HOME_M:
            rapid = (limits.rapid_m_s, limits.acceleration_m_s2, limits.jerk_m_s3)
            segments += [Move(-away_m, *rapid), Dwell(_HOME_REST_S)]
    else:
        segments = list(motion(limits, random))
    count = sum(samples_of(segment, rate_hz) for segment in segments)
    return CommandedMotion(name, Setpoints(iter(segments), limits.low_m, rate_hz), count)


def _numbered(out: Path, names: Sequence[str]) -> list[Path]:
    paths = [out / f"{k:02}_{name}.parquet" for k, name in enumerate(names, start=1)]
    try:
        out.mkdir(parents=True, exist_ok=True)
        there = {path for path in out.iterdir() if _NUMBERED.fullmatch(path.name)}
    except OSError as error:
        raise TraceError(f"{out}: no folder for recordings ({error.strerror})") from None
    if strange := sorted(there - set(paths)):
        raise SimulationError(
            f"{strange[0]}: is of another session; expected a new folder, or the same files"
        )
    return paths


def _number(text: str, key: str, unit: str, least: float) -> float:
    """Number of NAME:key=NUMBER."""
    name, _, number = text.partition(f":{key}=")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= least):
        raise SimulationError(f"{text}: expected {name.partition(':')[0]}:{key}={unit}")
    return value


def _force(path: Path) -> Floats:
    """Times, s, and forces, N, in a CSV file, (2, n)."""
    try:
        return force_profile(path.read_text("utf-8-sig"))
    except (OSError, ValueError) as error:
        raise SimulationError(f"{path}: cannot be read as time_s,force_n ({error})") from None
