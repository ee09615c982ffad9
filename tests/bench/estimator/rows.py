"""Rows of the estimator's bench: their aims, and whether they are met."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ..table import Table
from .aims import AIMS, Aim
from .plants.foreign import ROW as _FOREIGN
from .plants.own import Part
from .plants.spoiled import CASES
from .scores import Score, pooled

COVERAGE = (0.94, 0.96)
ALL_FOREIGN = f"{_FOREIGN}all scenarios"
_AGAIN = (ALL_FOREIGN, "after step 100")
_SPOILED = frozenset(case.name for case in CASES)


@dataclass(frozen=True, slots=True)
class BenchRow:
    """One row as measured; `ours` is None where it could not be."""

    row: str
    ours: Score | None
    thesis: Score | None
    aim: str
    met: bool | None
    added: float | None


HEADS = (
    *("row", "wrong", "rows", "cases", "thesis MAE", "MAE", "worst", "drop", "cover", "score"),
    *("seen s", "met", "aim"),
)


def table_of(parts: Sequence[Part]) -> Table:
    """Pool the parts of each row and hold them against the aims."""
    ours = _pooled_by_row(parts, lambda part: part.ours)
    thesis = _pooled_by_row(parts, lambda part: part.thesis)
    rows = [_row(name, aim, ours, thesis) for name, aim in AIMS.items()]
    rows.append(_coverage_row(rows))
    judged = [row.met for row in rows if row.met is not None]
    note = f"{sum(judged)} of {len(judged)} aims met; {_wrong(rows)}"
    return Table(HEADS, tuple((*_cells(row), _met(row), _remark(row)) for row in rows), (note,))


def _wrong(rows: Sequence[BenchRow]) -> str:
    """Count of confidently wrong numbers; rows made of others' numbers are left out."""
    scores = [row.ours for row in rows if row.ours and not row.row.endswith(_AGAIN)]
    answered = sum(each.answered for each in scores)
    wrong = sum(round(each.wrong * each.answered) for each in scores if each.wrong > 0.0)
    cases = sum(each.cases for each in scores)
    return f"confidently wrong: {wrong} of {answered} numbers in {cases} cases"


def _pooled_by_row(parts: Sequence[Part], pick: Callable[[Part], Score | None]) -> dict[str, Score]:
    found: dict[str, list[Score]] = {}
    for part in parts:
        one = pick(part)
        if one is None:
            continue
        found.setdefault(part.row, []).append(one)
        if part.row.startswith(_FOREIGN) and not part.row.endswith((" error", "one encoder")):
            found.setdefault(ALL_FOREIGN, []).append(one)
    return {row: pooled(scores) for row, scores in found.items()}


def _row(name: str, aim: Aim, ours: Mapping[str, Score], thesis: Mapping[str, Score]) -> BenchRow:
    mine, text = ours.get(name), aim.text()
    if mine is None:
        return BenchRow(name, None, None, text or "-", None, None)
    reference = ours.get(aim.reference or "")
    added = None if reference is None else mine.mae - reference.mae
    met = aim.met(mine, reference) if text else None
    return BenchRow(name, mine, thesis.get(name), text, met, added)


def _coverage_row(rows: Sequence[BenchRow]) -> BenchRow:
    """Count of rows with honest intervals, too wide ones counted as missed."""
    shares = [row.ours.coverage for row in rows if row.ours and not math.isnan(row.ours.coverage)]
    low, high = COVERAGE
    honest = sum(low <= each <= high for each in shares)
    name = f"coverage: {honest} rows of {len(shares)} within, {sum(c > high for c in shares)} above"
    return BenchRow(
        name, None, None, f"each within {low:g} to {high:g}", honest == len(shares), None
    )


def _cells(row: BenchRow) -> tuple[object, ...]:
    ours = row.ours
    if ours is None:
        return (row.row, *[None] * 10)
    return (
        row.row,
        ours.wrong,
        ours.answered,
        ours.cases,
        math.nan if row.thesis is None else row.thesis.mae,
        ours.mae,
        ours.worst,
        ours.false_drop,
        ours.coverage,
        ours.interval_score,
        ours.detection_s,
    )


def _remark(row: BenchRow) -> str:
    """The aim, what was added, and for spoiled recordings what was said."""
    remark = row.aim or "-"
    if row.added is not None:
        remark += f"; added {row.added:+.3f}"
    if row.ours is not None and row.row in _SPOILED:
        remark += f"; misleading {row.ours.misleading:.1%}; {', '.join(row.ours.notes)}"
    return remark


def _met(row: BenchRow) -> str:
    if row.met is None:
        return "-" if row.ours is not None else "no data"
    return "yes" if row.met else "MISSED"
