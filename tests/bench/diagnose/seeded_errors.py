"""The diagnosis on recordings of real machines, to whose torque an error of known size is added.

What lies beneath the error is a machine that nobody simulated: friction that wanders, a drive and
encoders of its own. The error is a formula over the recorded position, not an entry of the library.
"""

import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy import signal

from edge_service.diagnose.result import Diagnosis
from edge_service.diagnose.session.session import rms
from edge_service.messages.samples import Floats
from edge_service.offline.diagnosis.diagnose import diagnose
from edge_service.offline.diagnosis.gap import BadDataError
from edge_service.recordings.conditioning import white_noise_rms

from ..real_machines import ACTUATOR_TOML, SEQUENCES, moves, one_actuator, written
from ..table import BenchError, Progress, Table, in_processes

MAGNITUDES = {"small": 0.1, "medium": 0.25, "large": 0.6}
"""Greatest torque of an error over the root mean square of the torque in motion."""
_EMPS = """
[axis]
name = "EMPS"
lead_m = 0.0025

[model]
inertia_kg_m2 = 1.505710e-5
viscous_nm_s_per_rad = 3.221751e-5
preload_drag_nm = 8.1142e-3
"""
_EMPS_RATIO, _EMPS_NM_PER_V = 0.0025 / (2.0 * math.pi), 0.0139859993
_CREEP, _SIGMAS = 0.002, 4.0
"""Of the greatest speed, below which an axis rests; a sensor's noise may make it more."""

Columns = Mapping[str, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A real recording, and recordings of the same machine that are its reference."""

    name: str
    machine_toml: str
    columns: Columns
    # position as it was commanded where the recorded one is too noisy to tell the direction, (n,)
    place_m: Floats | None
    reference: tuple[Columns, ...]
    alike: frozenset[str]  # effects that its motion cannot tell apart
    shown: frozenset[str]  # errors that it can show at all


@dataclass(frozen=True, slots=True)
class SeededCase:
    """A case: the error's name, empty for none, its size, and the recording it is added to."""

    recording: str
    error: str
    magnitude: str


@dataclass(frozen=True, slots=True)
class SeededRow:
    case: SeededCase
    verdict: str
    effects: tuple[tuple[str, float], ...]  # names and probabilities, the most probable first
    right: bool  # the first name is that of the error, or cannot be told from it


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Recorded motion, (n,) each: of the table, 1 at its greatest."""

    time_s: Floats
    place: Floats
    speed: Floats
    acceleration: Floats
    turn: Floats
    torque_nm: Floats
    still: float

    @property
    def way(self) -> Floats:
        """Direction, 0 at rest."""
        return np.where(np.abs(self.speed) > self.still, np.sign(self.speed), 0.0)


Shape = Callable[[Motion, np.random.Generator], Floats]
"""Torque of an error, (n,), about 1 at its greatest."""


def _burst(motion: Motion, random: np.random.Generator) -> Floats:
    span = float(np.ptp(motion.time_s))
    start = motion.time_s[0] + span * random.uniform(0.2, 0.6)
    inside = (motion.time_s > start) & (motion.time_s < start + 0.15 * span)
    return np.where(inside, 1.0, 0.0)


def _bump(motion: Motion, random: np.random.Generator) -> Floats:
    place = random.uniform(0.3, 0.7)
    bump: Floats = motion.way * np.exp(-(((motion.place - place) / 0.15) ** 2))
    return bump


def _since_rest(motion: Motion, _random: np.random.Generator) -> Floats:
    """Friction that breaks away after each rest, and eases within a fifth of a second."""
    moving = motion.way != 0.0
    started = np.flatnonzero(moving & ~np.insert(moving[:-1], 0, False))
    since = np.full(len(moving), np.inf)
    for first in started.tolist():
        since[first:] = motion.time_s[first:] - motion.time_s[first]
    eased: Floats = motion.way * np.exp(-since / 0.2)
    return eased


KNOWN: Mapping[str, Shape] = {
    "drag_error": lambda m, _r: m.way,
    "viscous_error": lambda m, _r: m.speed,
    "inertia_error": lambda m, _r: m.acceleration,
    "torque_gain_error": lambda m, _r: m.torque_nm / float(np.abs(m.torque_nm).max()),
    "load_offset": lambda m, _r: np.ones_like(m.speed),
    "position_friction": _bump,
    "torque_ripple": lambda m, r: np.sin(r.integers(3, 9) * m.turn),
    "stribeck": lambda m, _r: m.way * np.exp(-np.abs(m.speed) / 0.12),
    "quadratic_friction": lambda m, _r: m.speed * np.abs(m.speed),
    "external_force": _burst,
}
"""Errors that an entry of the library describes, under its name."""
OPEN: Mapping[str, Shape] = {
    "break-away": _since_rest,
    "droop": lambda m, _r: m.torque_nm * np.abs(m.torque_nm) / float(np.max(m.torque_nm**2)),
    "hum": lambda m, _r: np.sin(2.0 * math.pi * 1.3 * m.time_s),
    "even in speed": lambda m, _r: m.speed**2,
}
"""Errors that no entry describes."""


def recordings(folder: Path) -> list[Recording]:
    """All recordings that are there. Raises BenchError: there are none."""
    if found := [*_of_emps(folder), *_of_cranfield(folder)]:
        return found
    raise BenchError(f"no recording of emps or cranfield in {folder}")


def _of_emps(folder: Path) -> Iterator[Recording]:
    path = folder / "emps" / "emps_estimation.csv"
    if not path.is_file():
        return
    table = np.loadtxt(path, delimiter=",", skiprows=1)
    columns = {
        "time_s": table[:, 0],
        "torque_command_nm": _EMPS_NM_PER_V * table[:, 3],
        "motor_angle_rad": table[:, 2] / _EMPS_RATIO,
    }
    middle = len(table) // 2
    halves = [
        {name: values[part] for name, values in columns.items()}
        for part in (slice(0, middle), slice(middle, None))
    ]
    for k, half in enumerate(halves):
        shown = frozenset(KNOWN) | frozenset(OPEN)
        yield Recording(f"emps {k}", _EMPS, half, None, (halves[1 - k],), frozenset(), shown)


def _of_cranfield(folder: Path) -> Iterator[Recording]:
    path = folder / "cranfield" / "normal.csv"
    if not path.is_file():
        return
    for load, every in moves(path).items():
        parts = [
            every[first : first + SEQUENCES]
            for first in range(0, len(every) - SEQUENCES + 1, SEQUENCES)
        ]
        # one speed both ways, one sensor, and a current without a sign
        alike = frozenset({"drag_error", "viscous_error", "torque_gain_error", "load_friction"})
        shown = frozenset({"drag_error", "load_offset", "position_friction"})
        for k in (len(parts) - 2, len(parts) - 1):
            reference = tuple(one_actuator(each) for each in parts[: len(parts) - 2])
            name = f"cranfield {load} kgf {k}"
            commanded_m = 1e-3 * np.concatenate([each[:, 1] for each in parts[k]])
            columns = one_actuator(parts[k])
            yield Recording(name, ACTUATOR_TOML, columns, commanded_m, reference, alike, shown)


def motion_of(recording: Recording) -> Motion:
    """Motion of a recording, smoothed over some fortieths of a second."""
    columns, place = recording.columns, recording.place_m
    time_s = columns["time_s"]
    if place is None:
        place = columns["motor_angle_rad"]
    period_s = float(np.median(np.diff(time_s)))
    window = 2 * max(round(0.025 / period_s), 2) + 1
    speed, acceleration = (
        signal.savgol_filter(place, window, 3, deriv=order, delta=period_s) for order in (1, 2)
    )
    weights = signal.savgol_coeffs(window, 3, deriv=1, delta=period_s)
    noise = white_noise_rms(place) * float(np.sqrt(np.sum(weights**2)))
    fastest = float(np.quantile(np.abs(speed), 0.999))
    low, high = float(place.min()), float(place.max())
    turn = columns.get("motor_angle_rad", np.zeros_like(place))
    return Motion(
        time_s,
        (place - low) / (high - low),
        speed / fastest,
        acceleration / float(np.quantile(np.abs(acceleration), 0.999)),
        turn,
        columns["torque_command_nm"],
        max(_CREEP, _SIGMAS * noise / fastest),
    )


def with_error(recording: Recording, case: SeededCase, seed: int) -> dict[str, Floats]:
    if not case.error:
        return dict(recording.columns)
    motion = motion_of(recording)
    level_nm = MAGNITUDES[case.magnitude] * rms(motion.torque_nm[motion.way != 0.0])
    shape = {**KNOWN, **OPEN}[case.error]
    sign = np.random.default_rng([seed, 1]).choice((-1.0, 1.0))
    if case.error in OPEN or case.error == "stribeck":
        sign = 1.0
    if case.error == "drag_error" and level_nm > _dry_friction_nm(motion):
        sign = 1.0  # no axis has less than no friction: that would be bad data
    added = sign * level_nm * shape(motion, np.random.default_rng([seed, 2]))
    return {**recording.columns, "torque_command_nm": motion.torque_nm + added}


def _dry_friction_nm(motion: Motion) -> float:
    """Dry friction that the machine has itself, by least squares."""
    terms = (motion.way, motion.speed, motion.acceleration, np.ones_like(motion.way))
    moving = motion.way != 0.0
    fit = np.linalg.lstsq(np.column_stack(terms)[moving], motion.torque_nm[moving], rcond=None)
    return float(fit[0][0])


def plan(found: Sequence[Recording]) -> list[SeededCase]:
    """All cases: each recording as it is, and with each error that it can show in three sizes."""
    seeded = [
        SeededCase(each.name, error, magnitude)
        for each in found
        for error in (*KNOWN, *OPEN)
        if error in each.shown
        for magnitude in MAGNITUDES
    ]
    return [*(SeededCase(each.name, "", "") for each in found), *seeded]


def run_case(recording: Recording, case: SeededCase, seed: int) -> SeededRow:
    """Ask for one case, as a stranger would: by files."""
    with tempfile.TemporaryDirectory(prefix="seeded-") as home:
        folder = Path(home)
        (folder / "machine.toml").write_text(recording.machine_toml, "utf-8")
        healthy = enumerate(recording.reference)
        reference = [Path(written(folder / f"healthy{k}.csv", each)) for k, each in healthy]
        trace = Path(written(folder / "trace.csv", with_error(recording, case, seed)))
        with suppress(BadDataError):
            diagnose(folder / "machine.toml", [trace], folder / "out", reference=reference)
        text = (folder / "out" / "diagnosis.json").read_text("utf-8")
    found = Diagnosis.model_validate_json(text)
    effects = tuple((each.name, each.probability) for each in found.effects)
    alike = recording.alike if case.error in recording.alike else frozenset()
    first = found.effects[0].tied if effects else ("",)
    return SeededRow(case, found.verdict, effects, bool({case.error, *alike} & {*first}))


def run_seeded_errors(folder: Path, seed: int, say: Progress) -> Table:
    """Run all cases and count them. Raises BenchError without a recording."""
    by_name = {each.name: each for each in recordings(folder)}
    cases = plan(list(by_name.values()))
    jobs = [partial(run_case, by_name[c.recording], c, seed + k) for k, c in enumerate(cases)]
    rows = []
    for _, row in in_processes(jobs):
        rows.append(row)
        said = f"{row.case.recording}: {row.case.error or 'as it is'}"
        say(f"{len(rows)} of {len(cases)}: {said}")
    return Table.of(figures_of(rows), f"real machines in {folder}, seed {seed}")


def figures_of(rows: Sequence[SeededRow]) -> Iterator[Mapping[str, object]]:
    """Counts of right answers by kind and size."""
    known = [row for row in rows if row.case.error in KNOWN]
    claims = [row for row in rows if row.verdict in ("explained", "ambiguous")]
    for magnitude in MAGNITUDES:
        alike = [row for row in known if row.case.magnitude == magnitude]
        right = [row.right and row in claims for row in alike]
        yield _share(f"{magnitude} error of the library: named first", right)
    wrong = [not row.right and bool(row.effects) and row.effects[0][1] > 0.5 for row in known]
    yield _share("an error is named, but a wrong one, above .5", wrong)
    nameless = [
        not row.effects or row.verdict == "unknown" or row.effects[0][1] <= 0.5
        for row in rows
        if row.case.error in OPEN
    ]
    yield _share("error that no entry has: unknown, or none above .5", nameless)
    quiet = [row.verdict == "no_gap" for row in rows if not row.case.error]
    yield _share("as it is: no_gap", quiet)
    sure = [row.right for row in claims if row.effects[0][1] >= 0.9]
    yield _share("first name above .9 is right", sure)


def _share(name: str, holds: Sequence[bool]) -> Mapping[str, object]:
    return {"figure": name, "reached": f"{sum(holds)} of {len(holds)}" if holds else "-"}
