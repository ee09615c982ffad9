"""Score of the diagnosis: truth beside answer, and what is left of another recording's gap."""

import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from edge_service.config import load_machine
from edge_service.diagnose.result import SURE, Diagnosis, Verdict
from edge_service.diagnose.session.session import CHANNEL_UNITS, Session
from edge_service.messages.samples import SampleFrame
from edge_service.models.effects.learned import model_effects
from edge_service.models.effects.registry import active_effect, disturbance, effect_names
from edge_service.offline.diagnosis.diagnose import diagnose
from edge_service.offline.diagnosis.gap import BadDataError, read_runs, session_of
from edge_service.recordings.writer import TraceWriter
from edge_service.regression import FALSE_ALARMS

from .cases import FRESH, HiddenCase, Plant

LIKELY = 0.5
_HOLD_OUT = 500_000
_CLEAR = 1.5
"""Gap over its floor from which on there is something to shrink."""


@dataclass(frozen=True, slots=True, eq=False)
class CheckedCase:
    """A case with its answer."""

    case: HiddenCase
    found: Diagnosis
    # effect -> how far it shrinks the gap of another recording of the same axis
    realised: dict[str, float]
    # channel -> gap of that other recording, before and with augmented.toml
    again: dict[str, tuple[float, float]]

    @property
    def named(self) -> dict[str, float]:
        """Effect -> probability, the most probable first."""
        return {each.name: each.probability for each in self.found.effects}

    @property
    def there(self) -> set[str]:
        return self.case.names & set(effect_names()) - set(self.case.withheld)

    @property
    def likely(self) -> set[str]:
        return {name for name, p in self.named.items() if p > LIKELY}

    @property
    def kind(self) -> str:
        if not self.there:
            return "no entry" if self.case.causes else "healthy"
        return {1: "single", 2: "pair", 3: "triple"}.get(len(self.case.names), "more")

    @property
    def outcome(self) -> str:
        """Answer in a word: named, in part, quiet, rightly unknown, unknown, missed or wrong.

        Wrong is to be sure of what is not there; in part, that some causes are likely or tied.
        """
        is_sure = any(p > SURE and name not in self.there for name, p in self.named.items())
        if is_sure or (self.named and not self.case.causes):
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
        gap = {
            name: {"before": before, "after": after, "unit": CHANNEL_UNITS[name]}
            for name, (before, after) in self.again.items()
        }
        realised = [{"name": name, "share": share} for name, share in self.realised.items()]
        case = {"truth": self.case.causes, "without": self.case.withheld, "seed": self.case.seed}
        said = {"outcome": self.outcome, "gap": gap, "realised": realised, "diagnosis": self.found}
        return case | said

    @property
    def words(self) -> str:
        """Truth, answer and gap on one line."""
        named = ", ".join(f"{n} {p:.2f}" for n, p in self.named.items()) or "nothing"
        case, without = self.case, ", ".join(self.case.withheld)
        lacking = f" (library without {without})" if without else ""
        hidden = f"{'+'.join(case.causes) or 'healthy'} x{case.strength:g} {case.motion}"
        gaps = ", ".join(
            f"{name} {before:.3g} -> {after:.3g} {CHANNEL_UNITS[name]}"
            for name, (before, after) in self.again.items()
        )
        said = f"{hidden} {case.seed}{lacking}; answer {self.found.verdict.value}: {named}"
        return f"{self.outcome}: {said}; other recording: {gaps}"


def checked(plant: Plant, case: HiddenCase) -> CheckedCase:
    """Record a case, diagnose it by files as a user would, and measure on another recording."""
    with tempfile.TemporaryDirectory(prefix="check-") as home:
        names = ("machine.toml", "trace.parquet", "fresh.parquet", "out")
        machine_file, trace, fresh, out = (Path(home) / name for name in names)
        machine_file.write_text(plant.machine_toml, "utf-8")
        machine = load_machine(machine_file)
        _record(trace, plant.recorded(case, case.motion, case.seed))
        with suppress(BadDataError):
            diagnose(machine_file, [trace], out, without=case.withheld)
        found = Diagnosis.model_validate_json((out / "diagnosis.json").read_text("utf-8"))
        _record(fresh, plant.recorded(case, FRESH, case.seed + _HOLD_OUT))
        before = session_of(machine, read_runs(machine, [fresh]))
        learned = model_effects(load_machine(out / "augmented.toml"))
        after = Session.of_runs(before.runs, before.baseline, learned)
    again = {name: (rows.rms, after.channels[name].rms) for name, rows in before.channels.items()}
    return CheckedCase(case, found, _realised(found, before), again)


def _record(path: Path, frame: SampleFrame) -> None:
    with TraceWriter(path, tuple(frame.channels)) as writer:
        writer.write(frame)


def _realised(found: Diagnosis, again: Session) -> dict[str, float]:
    """Shrink of another recording's gap by each named effect beside the others, in its channel."""

    def left(channel: str, lacking: str = "") -> float:
        others = (each for each in found.effects if each.name != lacking)
        made = [active_effect(each.name, values) for each in others for values in each.entries]
        return Session.of_runs(again.runs, again.baseline, made).channels[channel].rms

    return {e.name: 1.0 - left(e.channel) / left(e.channel, e.name) for e in found.effects}


def totals_of(rows: Sequence[CheckedCase]) -> dict[str, Any]:
    """Counts of outcomes by kind of case, realised shrinks beside claimed ones, calibration.

    Shrinks are those of right names; a force that nothing foretells does not come again.
    """
    said = np.array([(p, name in row.there) for row in rows for name, p in row.named.items()])
    # difference of probability and frequency of being right in each tenth
    p, is_right = said.reshape(-1, 2).T
    off = np.abs(np.bincount((10.0 * p).clip(0, 9).astype(int), p - is_right)).sum()
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
    healthy = [row.found.misfit for row in rows if row.found.misfit and not row.case.causes]
    kinds = {row.kind: Counter(x.outcome for x in rows if x.kind == row.kind) for row in rows}
    return {
        "outcomes": {kind: dict(each.most_common()) for kind, each in kinds.items()},
        "claimed_shrink_share": median(each.estimate for each, _ in pairs) if pairs else None,
        "realised_shrink_share": median(realised for _, realised in pairs) if pairs else None,
        "realised_of_possible_share": median(possible) if possible else None,
        "shrinks": len(pairs),
        "shrinks_in_interval": sum(claimed.low <= got <= claimed.high for claimed, got in pairs),
        "calibration_error_share": float(off) / len(p) if len(p) else None,
        "names": len(p),
        "controls": len(healthy),
        "false_alarms": sum(each.p_value < FALSE_ALARMS for each in healthy),
    }


def total_lines(totals: Mapping[str, Any]) -> list[str]:
    lines = [
        f"{kind}: {', '.join(f'{count} {outcome}' for outcome, count in counts.items())}"
        for kind, counts in totals["outcomes"].items()
    ]
    if totals["shrinks"]:
        claimed, got = (100.0 * totals[f"{k}_shrink_share"] for k in ("claimed", "realised"))
        said = f"claimed {claimed:.0f} %, realised {got:.0f} %; the 90 % interval holds"
        held = f"{totals['shrinks_in_interval']} of {totals['shrinks']}"
        lines.append(f"shrink by each right name, median: {said} {held}")
    if (share := totals["realised_of_possible_share"]) is not None:
        lines.append(f"of what any model could take off other recordings, median: {share:.0%}")
    if totals["names"]:
        off = totals["calibration_error_share"]
        lines.append(f"calibration error of the probabilities: {off:.3f}, {totals['names']} names")
    if totals["controls"]:
        false, count = totals["false_alarms"], totals["controls"]
        lines.append(f"healthy axes with a chance below {FALSE_ALARMS}: {false} of {count}")
    return lines
