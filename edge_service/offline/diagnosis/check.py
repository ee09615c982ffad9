"""`edge-service check-diagnosis`: hidden effects, what the diagnosis says of them, and its score.

A plant records an axis with effects that nobody tells the diagnosis of. Its answer goes into the
machine file, and the gap is measured on another recording of the same axis. The truth is written
beside the answer afterwards.
"""

import difflib
import math
import tempfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib.metadata import entry_points
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from ...atomic import replaced_file
from ...command_answer import Answer
from ...config import DEFAULT_MACHINE, load_machine
from ...diagnose.experiment import simulated_axis
from ...diagnose.result import SURE, Diagnosis, Series, Verdict, learnable
from ...diagnose.session.session import CHANNEL_UNITS, Session
from ...messages.samples import SampleFrame
from ...models.effects.effect import ActiveEffect, Role
from ...models.effects.learned import model_effects
from ...models.effects.registry import (
    active_effect,
    disturbance,
    effect_names,
    get_effect,
    parse_effect,
)
from ...models.machine import Machine
from ...recordings.writer import TraceWriter
from ..recordings import Progress, silent
from .diagnose import augmented_toml, examined, library_without
from .gap import DiagnosisError, one_line, read_runs, session_of

PLANTS = "edge_service.plants"
"""Entry points of plants that share no code with the library."""
LIKELY = 0.5
STRENGTHS = (0.5, 1.0, 2.0)
"""Of a typical fault."""
FRESH = "production"
"""Motion of the recording that shows how far the gap really shrinks."""
_HOLD_OUT = 500_000
_CLEAR = 1.5
"""Gap over its floor from which on there is something to shrink."""
_PRODUCTION_S = 60.0
_KINDS = ("healthy", "single", "single", "single", "pair", "odd", "out", "triple")


@dataclass(frozen=True, slots=True)
class HiddenCase:
    """Effects of one axis, by name or as NAME:KEY=VALUE,..., and what the library is to lack."""

    causes: tuple[str, ...]
    strength: float
    motion: str
    seed: int
    withheld: tuple[str, ...] = ()

    @property
    def names(self) -> set[str]:
        """Names of the effects."""
        return {each.partition(":")[0] for each in self.causes}

    @property
    def label(self) -> str:
        """Short name of the case."""
        return f"{'+'.join(self.causes) or 'healthy'} x{self.strength:g} {self.motion} {self.seed}"


@dataclass(frozen=True, slots=True)
class Plant:
    """Axis that records hidden effects.

    Attributes:
        machine_toml: its machine file, which knows of none of them.
        known: names of effects that it can have, and the library too.
        odd: of those that the library lacks.
        recorded: recording of the axis of a case, on a motion, with a seed of its own.
    """

    machine_toml: str
    known: Sequence[str]
    odd: Sequence[str]
    motions: Sequence[str]
    recorded: Callable[[HiddenCase, str, int], SampleFrame]


def own_plant(machine_file: Path) -> Plant:
    """Simulated axis of a machine file, as stiff as its model, with effects of the library."""
    known = [name for name in effect_names() if not get_effect(name).is_fault]
    recorded = partial(_own_recorded, load_machine(machine_file))
    return Plant(machine_file.read_text("utf-8"), known, (), ("friction", FRESH), recorded)


def _own_recorded(machine: Machine, case: HiddenCase, motion: str, seed: int) -> SampleFrame:
    duration_s = _PRODUCTION_S if motion == FRESH else None
    with one_line():
        active = [_drawn(text, case) for text in case.causes]
        return simulated_axis(machine, motion, duration_s, effects=active, seed=seed)


def _drawn(text: str, case: HiddenCase) -> ActiveEffect:
    """Effect as it is given, or with amounts and phases by chance."""
    if ":" in text:
        return parse_effect(text)
    random, values = np.random.default_rng([case.seed, zlib.crc32(text.encode())]), {}
    for each in get_effect(text).parameters:
        if each.role is Role.AMOUNT:
            drawn = case.strength * random.uniform(0.8, 1.25) * each.faulty
            values[each.name] = min(max(drawn, each.low), each.high)
        elif each.role is Role.PHASE:
            values[each.name] = random.uniform(0.0, 2.0 * math.pi)
    return active_effect(text, values)


def foreign_plant() -> Plant:
    """Axis that shares no code with the library; its seed draws what its effects are."""
    plant = _installed()
    machine_toml, motions = (
        plant.nominal_machine_toml(plant.DIAGNOSIS),
        ("full", FRESH, "staircase"),
    )
    known = sorted(plant.FAULTS)
    odd = sorted(name for name, each in plant.ODDITIES.items() if each.channel != plant.NEITHER)
    return Plant(machine_toml, known, odd, motions, _foreign_recorded)


@cache
def _installed() -> Any:
    for entry in entry_points(group=PLANTS, name="foreign"):
        return entry.load()
    raise DiagnosisError("--plant foreign: not installed; sh deploy/setup.sh sets it up")


def _foreign_recorded(case: HiddenCase, motion: str, seed: int) -> SampleFrame:
    plant, there = _installed(), tuple((name, case.strength) for name in case.causes)
    made = plant.case(there, motion, seed=seed, axis_seed=case.seed)
    columns = dict(plant.simulate(made).columns)
    return SampleFrame(columns.pop("time_s"), columns)


@dataclass(frozen=True, slots=True, eq=False)
class CheckedCase:
    """A case with its answer.

    Attributes:
        realised: effect -> how far it shrinks the gap of another recording of the same axis.
        again: channel -> gap of that other recording, before and with augmented.toml.
    """

    case: HiddenCase
    found: Diagnosis
    realised: dict[str, float]
    again: dict[str, tuple[float, float]]

    @property
    def named(self) -> dict[str, float]:
        """Effect -> probability, the most probable first."""
        return {each.name: each.probability for each in self.found.effects}

    @property
    def there(self) -> set[str]:
        """Causes that the library has."""
        return self.case.names & set(effect_names()) - set(self.case.withheld)

    @property
    def likely(self) -> set[str]:
        """Names that are likely."""
        return {name for name, p in self.named.items() if p > LIKELY}

    @property
    def is_wrong(self) -> bool:
        """Something is named with confidence that is not there."""
        return any(p > SURE and name not in self.there for name, p in self.named.items())

    @property
    def kind(self) -> str:
        """Sort of the case."""
        if not self.there:
            return "no entry" if self.case.causes else "healthy"
        return {1: "single", 2: "pair", 3: "triple"}.get(len(self.case.names), "more")

    @property
    def outcome(self) -> str:
        """Answer in a word: named, in part, quiet, rightly unknown, unknown, missed or wrong.

        Wrong is to be sure of what is not there; in part, that some causes are likely or tied.
        """
        if self.is_wrong or (self.named and not self.case.causes):
            return "wrong"
        is_quiet = self.found.verdict is Verdict.NO_GAP
        if not self.case.causes:
            return "quiet" if is_quiet else "unknown"
        if not self.there:
            return "missed" if is_quiet else "rightly unknown"
        if self.case.names <= self.likely:
            return "named"
        if self.there & {name for each in self.found.effects for name in each.tied}:
            return "in part"
        return "missed" if is_quiet else "unknown"

    @property
    def document(self) -> dict[str, Any]:
        """The same for programs."""
        gap = {
            name: {"before": before, "after": after, "unit": CHANNEL_UNITS[name]}
            for name, (before, after) in self.again.items()
        }
        realised = [{"name": name, "share": share} for name, share in self.realised.items()]
        case = {"truth": self.case.causes, "without": self.case.withheld, "seed": self.case.seed}
        said = {"outcome": self.outcome, "gap": gap, "realised": realised}
        return case | said | {"diagnosis": self.found}

    @property
    def words(self) -> str:
        """Truth, answer and gap on one line."""
        named = ", ".join(f"{name} {p:.2f}" for name, p in self.named.items()) or "nothing"
        lacking = (
            f" (library without {', '.join(self.case.withheld)})" if self.case.withheld else ""
        )
        gaps = ", ".join(
            f"{name} {before:.3g} -> {after:.3g} {CHANNEL_UNITS[name]}"
            for name, (before, after) in self.again.items()
        )
        said = f"{self.case.label}{lacking}; answer {self.found.verdict.value}: {named}"
        return f"{self.outcome}: {said}; other recording: {gaps}"


def checked(plant: Plant, case: HiddenCase) -> CheckedCase:
    """Record a case, diagnose it by files as a user would, and measure on another recording."""
    with tempfile.TemporaryDirectory(prefix="check-") as home:
        folder = Path(home)
        machine_file, augmented = folder / "machine.toml", folder / "augmented.toml"
        trace, fresh = folder / "trace.parquet", folder / "fresh.parquet"
        _write(machine_file, plant.machine_toml)
        _record(trace, plant.recorded(case, case.motion, case.seed))
        machine = load_machine(machine_file)
        _, found, _ = examined(machine, [trace], without=case.withheld)
        _write(augmented, augmented_toml(plant.machine_toml, learnable(found)))
        _record(fresh, plant.recorded(case, FRESH, case.seed + _HOLD_OUT))
        before = session_of(machine, read_runs(machine, [fresh]))
        after = before.with_model(model_effects(load_machine(augmented)))
    again = {name: (rows.rms, after.channels[name].rms) for name, rows in before.channels.items()}
    found = found.model_copy(update={"series": Series()})
    return CheckedCase(case, found, _realised(found, before), again)


def _write(path: Path, text: str) -> None:
    with replaced_file(path) as file:
        file.write(text)


def _record(path: Path, frame: SampleFrame) -> None:
    with TraceWriter(path, tuple(frame.channels)) as writer:
        writer.write(frame)


def _realised(found: Diagnosis, again: Session) -> dict[str, float]:
    """Shrink of another recording's gap by each named effect beside the others, in its channel."""
    active = {
        each.name: [active_effect(each.name, values) for values in each.entries]
        for each in found.effects
    }
    shrinks = {}
    for each in found.effects:
        others = [effect for name, mine in active.items() if name != each.name for effect in mine]
        before, after = (
            again.with_model([*again.modelled, *more]).channels[each.channel].rms
            for more in (others, [*others, *active[each.name]])
        )
        shrinks[each.name] = 1.0 - after / before
    return shrinks


def plan(
    plant: Plant,
    count: int,
    seed: int,
    given: Sequence[str] = (),
    withheld: Sequence[str] = (),
) -> list[HiddenCase]:
    """Cases of given effects; or healthy ones, singles, pairs, triples and what nobody knows.

    Args:
        withheld: what the library is to lack; of every eighth case it is the cause itself.

    Raises DiagnosisError: an effect or its values that the plant, or the library, does not know.
    """
    library_without(withheld)
    for text in given:
        _check_effect(plant, text)
    random, cases = np.random.default_rng(seed), list[HiddenCase]()
    for k in range(count):
        kind, motion = _KINDS[k % len(_KINDS)], plant.motions[k % len(plant.motions)]
        strength, number = float(random.choice(STRENGTHS)), seed * 10_000 + k
        name, lacking = plant.known[(k // 2) % len(plant.known)], tuple(withheld)
        causes: tuple[str, ...] = tuple(given)
        if given:
            pass
        elif kind == "healthy":
            strength = 1.0
        elif kind == "odd" and plant.odd:
            causes = (str(random.choice(plant.odd)),)
        elif kind in ("odd", "out"):
            causes, strength, lacking = (name,), max(strength, 1.0), (*lacking, name)
        else:
            size = {"single": 1, "pair": 2, "triple": 3}[kind]
            others = [each for each in random.permutation(plant.known) if each != name][: size - 1]
            causes = (name, *map(str, others))
        cases.append(HiddenCase(causes, strength, motion, number, lacking))
    return cases


def _check_effect(plant: Plant, text: str) -> None:
    name, stated, _ = text.partition(":")
    there = [*plant.known, *plant.odd]
    if name not in there:
        near = difflib.get_close_matches(name, there, 3)
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        raise DiagnosisError(f"no effect {name!r}{hint}; the plant has {', '.join(there)}")
    if stated:
        if plant.odd:
            raise DiagnosisError(f"--effect {text}: a foreign plant draws the values; name it only")
        with one_line():
            parse_effect(text)


def check_diagnosis(
    plant: str,
    machine_file: Path | None,
    given: Sequence[str],
    withheld: Sequence[str],
    seed: int,
    count: int,
    progress: Progress = silent,
) -> Answer:
    """A line for each case, truth beside answer, and what they come to.

    Args:
        plant: `own` or `foreign`.
        machine_file: of the own plant; the thesis' bench unless given.

    Raises DiagnosisError: an effect that is not known, or a machine file for the foreign plant.
    """
    if plant != "own" and machine_file is not None:
        raise DiagnosisError("--machine: the foreign plant has a machine file of its own")
    axis = foreign_plant() if plant != "own" else own_plant(machine_file or DEFAULT_MACHINE)
    rows = []
    for number, case in enumerate(plan(axis, count, seed, given, withheld), 1):
        progress(f"case {number} of {count}: {100 * (number - 1) // count} %")
        rows.append(checked(axis, case))
    totals = totals_of(rows)
    lines = [*(row.words for row in rows), *total_lines(totals)]
    return Answer("\n".join(lines), {"cases": [row.document for row in rows], "totals": totals})


def calibration_error(rows: Iterable[CheckedCase]) -> tuple[float, int]:
    """Mean difference of probability and frequency of being right in each tenth; count of names."""
    tenths: dict[int, list[float]] = {}
    for row in rows:
        for name, p in row.named.items():
            tenths.setdefault(min(int(10.0 * p), 9), []).append(p - (name in row.there))
    count = sum(map(len, tenths.values()))
    return sum(abs(sum(each)) for each in tenths.values()) / max(count, 1), count


def totals_of(rows: Sequence[CheckedCase]) -> dict[str, Any]:
    """Counts of outcomes by kind of case, realised shrinks beside claimed ones, calibration.

    Shrinks are those of right names; a force that nothing foretells does not come again.
    """
    off, names = calibration_error(rows)
    pairs = [
        (each.shrink, row.realised[each.name])
        for row in rows
        for each in row.found.effects
        if each.probability > SURE and each.name in row.case.names - {disturbance()}
    ]
    possible = [
        (before - after) / (before - row.found.gap[name].floor)
        for row in rows
        if row.named and set(row.named) <= row.case.names - {disturbance()}
        for name, (before, after) in row.again.items()
        if before > _CLEAR * row.found.gap[name].floor
        and name in {each.channel for each in row.found.effects}
    ]
    kinds = {row.kind: Counter[str]() for row in rows}
    for row in rows:
        kinds[row.kind][row.outcome] += 1
    return {
        "outcomes": {kind: dict(each.most_common()) for kind, each in kinds.items()},
        "claimed_shrink_share": median(each.estimate for each, _ in pairs) if pairs else None,
        "realised_shrink_share": median(realised for _, realised in pairs) if pairs else None,
        "realised_of_possible_share": median(possible) if possible else None,
        "shrinks": len(pairs),
        "shrinks_in_interval": sum(claimed.low <= got <= claimed.high for claimed, got in pairs),
        "calibration_error_share": off if names else None,
        "names": names,
    }


def total_lines(totals: Mapping[str, Any]) -> list[str]:
    """The same in words."""
    lines = [
        f"{kind}: {', '.join(f'{count} {outcome}' for outcome, count in counts.items())}"
        for kind, counts in totals["outcomes"].items()
    ]
    if totals["shrinks"]:
        claimed, got = (100.0 * totals[f"{k}_shrink_share"] for k in ("claimed", "realised"))
        lines.append(
            f"shrink by each right name, median: claimed {claimed:.0f} %, realised {got:.0f} %; "
            f"the 90 % interval holds {totals['shrinks_in_interval']} of {totals['shrinks']}"
        )
    if totals["realised_of_possible_share"] is not None:
        share = 100.0 * totals["realised_of_possible_share"]
        lines.append(
            f"of what any model could take off the other recordings, median: {share:.0f} %"
        )
    if totals["names"]:
        off = totals["calibration_error_share"]
        lines.append(f"calibration error of the probabilities: {off:.3f}, {totals['names']} names")
    return lines
