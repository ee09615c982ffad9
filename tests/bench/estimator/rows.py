"""Rows of the estimator's bench: their aims, and whether they are met."""

import math
from collections.abc import Callable, Mapping, Sequence

from ..table import Table
from .aims import AIMS, Aim
from .plants.foreign import ROW as _FOREIGN
from .plants.own import Part
from .scores import Score, pooled

COVERAGE = (0.94, 0.96)
ALL_FOREIGN = f"{_FOREIGN}all scenarios"
_AGAIN = (ALL_FOREIGN, "after step 100")


def table_of(parts: Sequence[Part]) -> Table:
    """Pool the parts of each row and hold them against the aims."""
    ours = _pooled_by_row(parts, lambda part: part.ours)
    thesis = _pooled_by_row(parts, lambda part: part.thesis)
    rows = [_row(name, aim, ours, thesis) for name, aim in AIMS.items()]
    rows.append(_coverage_row([ours[name] for name in AIMS if name in ours]))
    judged = [row["met"] for row in rows if row["met"] in ("yes", "MISSED")]
    return Table.of(rows, f"{judged.count('yes')} of {len(judged)} aims met; {_wrong(ours)}")


def _wrong(ours: Mapping[str, Score]) -> str:
    """Count of confidently wrong numbers; rows made of others' numbers are left out."""
    scores = [ours[name] for name in AIMS if name in ours and not name.endswith(_AGAIN)]
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
        if part.row.startswith(_FOREIGN) and not part.row.endswith("one encoder"):
            found.setdefault(ALL_FOREIGN, []).append(one)
    return {row: pooled(scores) for row, scores in found.items()}


def _row(
    name: str, aim: Aim, ours: Mapping[str, Score], thesis: Mapping[str, Score]
) -> Mapping[str, object]:
    mine, met = ours.get(name), "no data"
    if mine is not None:
        met = ("yes" if aim.met(mine) else "MISSED") if aim.text() else "-"
    counted = mine or Score(0, 0)
    return {
        "row": name,
        "wrong": counted.wrong,
        "rows": counted.answered if mine else None,
        "cases": counted.cases if mine else None,
        "thesis MAE": thesis[name].mae if name in thesis else None,
        "MAE": counted.mae,
        "worst": counted.worst,
        "drop": counted.false_drop,
        "cover": counted.coverage,
        "score": counted.interval_score,
        "seen s": counted.detection_s,
        "met": met,
        "aim": aim.text() or "-",
    }


def _coverage_row(ours: Sequence[Score]) -> Mapping[str, object]:
    """Count of rows with honest intervals, too wide ones counted as missed."""
    shares = [each.coverage for each in ours if not math.isnan(each.coverage)]
    low, high = COVERAGE
    honest = sum(low <= each <= high for each in shares)
    name = f"coverage: {honest} rows of {len(shares)} within, {sum(c > high for c in shares)} above"
    met = "yes" if honest == len(shares) else "MISSED"
    return {"row": name, "met": met, "aim": f"each within {low:g} to {high:g}"}
