"""Dates that the trend states for screws of many kinds, beside a straight line, and what came.

`python -m tests.bench.wear.bench` prints it.
"""

import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from edge_service.messages.samples import Floats
from edge_service.offline.reproduce.wear import LIMITS, WearTest, crossing

from ..table import Section
from .histories import LAWS, WEARING, Law, history
from .straight_line import Dates, Stage, Tally, paired_scores, stages, tally

LIVES = 16
HEALTHY_STAGES = 60


@dataclass(frozen=True, slots=True)
class LawPart:
    """All screws that wear by one law.

    Attributes:
        trend, line: account of every screw.
        scores: of dates that both stated, trend and line, (n, 2).
    """

    law: Law
    trend: tuple[Tally, ...]
    line: tuple[Tally, ...]
    scores: Floats


def lives_of(law: Law, lives: int = LIVES, seed: int = 1) -> LawPart:
    """Ask about `lives` screws at every third stage, until the last limit is crossed."""
    rng = np.random.default_rng([seed, LAWS.index(law)])
    parts = [_asked(history(law, rng), law) for _ in range(lives)]
    trend, line, scores = zip(*parts, strict=True)
    return LawPart(law, trend, line, np.concatenate(scores))


def _asked(test: WearTest, law: Law) -> tuple[Tally, Tally, Floats]:
    came = {limit: crossing(test, limit).first_h for limit in LIMITS}
    if law == "none":
        came = dict.fromkeys(LIMITS, 1e9)  # anything sooner is false
        last = HEALTHY_STAGES
    else:
        last = int(np.searchsorted(test.time_h, min(max(came.values()), test.time_h[-1])))
    seen = WearTest(test.time_h[:last], test.distance_m[:last], test.drag_nm[:last])
    asked = stages(seen)
    return (
        tally(asked, came, trend_of),
        tally(asked, came, line_of),
        paired_scores(asked, came),
    )


def trend_of(stage: Stage) -> Dates:
    """Dates of the trend."""
    return stage.trend


def line_of(stage: Stage) -> Dates:
    """Dates of the line."""
    return stage.line


def share(tallies: Iterable[Tally], part: str, of: str) -> float:
    """Share over all tallies, such as `held` of `stated`."""
    every = list(tallies)
    whole = sum(getattr(each, of) for each in every)
    return sum(getattr(each, part) for each in every) / whole if whole else float("nan")


def wear_section(parts: Sequence[LawPart]) -> Section:
    """Table with a row for each law and one for all that wear."""
    rows: list[tuple[str, tuple[object, ...]]] = [(p.law, _figures([p])) for p in parts]
    rows.append(("all that wear", _figures([p for p in parts if p.law in WEARING])))
    return Section(
        "wear laws",
        "crossing of 90, 85 and 80 % of fresh",
        ("screws", "stated", "held", "score", "line held", "line score", "lead h"),
        tuple(rows),
        (
            "stated: share of questions with a date; held: share of 90 % bands that hold the first",
            "crossing; score: weighted interval score of dates that both state, share of the date",
        ),
    )


def _figures(parts: Sequence[LawPart]) -> tuple[object, ...]:
    trend = [each for part in parts for each in part.trend]
    line = [each for part in parts for each in part.line]
    scores = np.concatenate([part.scores for part in parts])
    wear = parts[0].law in WEARING
    leads = [lead for each in trend for lead in each.lead_h.values() if wear]
    return (
        len(trend),
        share(trend, "stated", "asked"),
        share(trend, "held", "stated") if wear else float("nan"),
        float(scores[:, 0].mean()) if wear else float("nan"),
        share(line, "held", "stated") if wear else float("nan"),
        float(scores[:, 1].mean()) if wear else float("nan"),
        round(float(np.median(leads))) if leads else float("nan"),
    )


def main() -> None:
    """Print the table."""
    sys.stdout.write(wear_section([lives_of(law) for law in LAWS]).as_text() + "\n")


if __name__ == "__main__":
    main()
