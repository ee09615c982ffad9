"""`edge-service reproduce wear FILE`: dates stated of a real screw, and what came."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ...atomic import replaced_file
from ...command_answer import Answer
from ..report.pictures import write_png
from .document import WearDocument
from .outcome import (
    LIMITS,
    Crossing,
    Stage,
    Tally,
    crossing,
    holds,
    paired_scores,
    stages,
    tally,
)
from .picture import draw_wear
from .stages import Schedule, WearTest, read_wear_test
from .statements import LEVEL, Date

_READINGS = {"first": "first reading below", "last": "below for good"}


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """All that was stated of one screw, and what came.

    Attributes:
        came: crossings by limit, percent of fresh.
        trend, line: by what counts as the crossing, `first` or `last`.
        paired: mean weighted interval score of the dates that both state, trend and line, share of
            the time until the crossing; NaN where there is none.
    """

    test: WearTest
    asked: tuple[Stage, ...]
    came: dict[float, Crossing]
    trend: dict[str, Tally]
    line: dict[str, Tally]
    paired: dict[str, tuple[float, float]]

    def as_text(self) -> str:
        """Table of all dates, then the account."""
        return "\n".join([*_table(self), *_summary(self)])

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values; what never came, or has no end within sight, is null."""
        found: dict[str, Any] = _finite(
            {
                "schema": "wear/1",
                "level": LEVEL,
                "fresh_drag_nm": float(self.test.drag_nm[0]),
                "stages": [asdict(stage) for stage in self.asked],
                "crossings": {limit: asdict(each) for limit, each in self.came.items()},
                "trend": {name: _account(each) for name, each in self.trend.items()},
                "line": {name: _account(each) for name, each in self.line.items()},
                "score_where_both_have_a_date": {
                    name: {"trend": each[0], "line": each[1]} for name, each in self.paired.items()
                },
            }
        )
        return found


def reproduce_wear(path: Path, schedule: Schedule, out: Path) -> Answer:
    """Write `wear.json` and `wear.png` into `out`. Raises TraceError."""
    found = account(read_wear_test(path, schedule))
    write_png(draw_wear(found.test, found.asked, found.came), out / "wear.png")
    with replaced_file(out / "wear.json") as file:
        json.dump(found.as_dict(), file, indent=1)
        file.write("\n")
    words = f"{found.as_text()}\npicture: {out / 'wear.png'}"
    return Answer(words, WearDocument.model_validate(found.as_dict()))


def account(test: WearTest, limits: Sequence[float] = LIMITS) -> Account:
    """Ask after every stage, then see what came."""
    asked = stages(test, limits)
    came = {limit: crossing(test, limit) for limit in limits}
    by = {name: {k: getattr(each, f"{name}_h") for k, each in came.items()} for name in _READINGS}
    return Account(
        test,
        tuple(asked),
        came,
        {name: tally(asked, times, lambda stage: stage.trend) for name, times in by.items()},
        {name: tally(asked, times, lambda stage: stage.line) for name, times in by.items()},
        {name: _mean_scores(asked, times) for name, times in by.items()},
    )


def _mean_scores(asked: Sequence[Stage], came_h: dict[float, float]) -> tuple[float, float]:
    scores = paired_scores(asked, came_h)
    trend, line = scores.mean(axis=0) if scores.size else (math.nan, math.nan)
    return float(trend), float(line)


def _account(each: Tally) -> dict[str, Any]:
    mean = float(np.mean(each.scores)) if each.scores else math.nan
    return asdict(each) | {"scores": mean, "coverage": each.coverage}


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {f"{k:g}" if isinstance(k, float) else k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _table(found: Account) -> list[str]:
    heads = [f"{limit:g} % of fresh" for limit in found.came]
    rows = [f"{'h':>6} {'drag %':>7}  " + "".join(f"{head:<26}" for head in heads).rstrip()]
    for stage in found.asked:
        dates = [_words(stage, limit, each) for limit, each in found.came.items()]
        cells = "".join(f"{each:<26}" for each in dates)
        rows.append(f"{stage.time_h:6.0f} {stage.percent:7.1f}  {cells}".rstrip())
    return rows


def _words(stage: Stage, limit: float, came: Crossing) -> str:
    """Date with its band, and whether it holds what came; `passed` once a reading lay below."""
    date = stage.trend.get(limit)
    if date is None:
        return "passed" if stage.time_h >= came.first_h else "no date yet"
    return f"{_band(date)} {_verdict(date, came)}"


def _band(date: Date) -> str:
    latest = f"{date.latest_h:.0f}" if math.isfinite(date.latest_h) else "open"
    return f"{date.likely_h:.0f} ({date.earliest_h:.0f} to {latest})"


def _verdict(date: Date, came: Crossing) -> str:
    if not math.isfinite(came.first_h):
        return "?"
    return "held" if holds(date, came.first_h) else "missed"


def _summary(found: Account) -> list[str]:
    lines = [_came(limit, each) for limit, each in found.came.items()]
    for name, words in _READINGS.items():
        trend, line = found.trend[name], found.line[name]
        ours, theirs = found.paired[name]
        score = f"trend {ours:.3f}, straight line {theirs:.3f}" if ours >= 0.0 else "no such date"
        lines += [
            f"crossing = {words}:",
            f"  trend          {_counts(trend)}",
            f"  straight line  {_counts(line)}",
            f"  score of dates where both have one, share of the date, less is better: {score}",
            f"  first date that held, h ahead: {_leads(trend)}",
        ]
    return lines


def _came(limit: float, each: Crossing) -> str:
    if not math.isfinite(each.first_h):
        return f"{limit:g} % of fresh: not reached"
    last = f"for good at {each.last_h:.0f} h" if math.isfinite(each.last_h) else "not for good"
    return f"{limit:g} % of fresh: first reading below at {each.first_h:.0f} h, {last}"


def _counts(each: Tally) -> str:
    if not each.asked:
        return "no limit was reached"
    silent = 1.0 - each.stated / each.asked
    return (
        f"{each.held} of {each.stated} {LEVEL:.0%} bands held what came; no date yet in "
        f"{silent:.0%} of {each.asked} questions; {each.said_after} dates after the crossing"
    )


def _leads(each: Tally) -> str:
    found = [f"{limit:g} %: {lead_h:.0f}" for limit, lead_h in sorted(each.lead_h.items())[::-1]]
    return ", ".join(found) or "none"
