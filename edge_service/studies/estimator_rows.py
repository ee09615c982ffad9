"""Rows of the estimator's bench: their aims, and whether they are met."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass

from .estimator_foreign import ROW as _FOREIGN
from .estimator_hostile import CASES
from .estimator_own import ERRORS, Part
from .estimator_scores import Score, pooled

COVERAGE = (0.94, 0.96)
_WORDS = {
    "mae": "MAE <= {:g}",
    "worst": "worst <= {:g}",
    "false_drop": "false drop <= {:g}",
    "detection_s": "seen <= {:g} s",
    "interval_score": "score <= {:g}",
    "coverage": "coverage >= {:g}",
    "misleading": "misleading <= {:g}",
    "added": "added MAE <= {:g}",
    "grown": "MAE within {:.0%}",
}


@dataclass(frozen=True, slots=True)
class Aim:
    """Limits of a row; None where there is none.

    Attributes:
        added: of the mean absolute error above that of the row `reference`.
        grown: of the same as a share.
        misleading: of the share of misleading numbers.
    """

    mae: float | None = None
    worst: float | None = None
    false_drop: float | None = None
    detection_s: float | None = None
    interval_score: float | None = None
    coverage: float | None = None
    misleading: float | None = None
    added: float | None = None
    grown: float | None = None
    reference: str | None = None

    def text(self) -> str:
        """As printed."""
        limits = ((words, getattr(self, name)) for name, words in _WORDS.items())
        return ", ".join(words.format(limit) for words, limit in limits if limit is not None)

    def met(self, ours: Score, reference: Score | None) -> bool:
        """Whether every limit is kept; what could not be measured is not."""
        kept = [
            _within(getattr(ours, name), getattr(self, name))
            for name in ("mae", "worst", "false_drop", "detection_s", "interval_score")
        ]
        kept.append(self.misleading is None or ours.misleading <= self.misleading)
        kept.append(self.coverage is None or ours.coverage >= self.coverage)
        base = math.nan if reference is None else reference.mae
        kept.append(_within(abs(ours.mae - base) / base, self.grown))
        kept.append(_within(ours.mae - base, self.added))
        return all(kept)


def _within(value: float, limit: float | None) -> bool:
    return limit is None or value <= limit


def _aims() -> dict[str, Aim]:
    """Every row with its aim, in the order of the table."""
    late = (0.022, 0.022, 0.012, 0.025)
    aims: dict[str, Aim] = {}
    for simulation, limit in enumerate(late, start=1):
        seen_s = 0.2 if simulation == 4 else None
        name = f"seed's simulation {simulation}"
        aims[f"{name}, open loop"] = Aim(mae=0.035, detection_s=seen_s)
        aims[f"{name}, after step 100"] = Aim(mae=limit)
    aims["seed's one-point step, open loop"] = Aim(detection_s=0.5)
    aims["T = 0.1 s"] = Aim()
    aims |= {
        f"T = {interval} s": Aim(grown=0.1, reference="T = 0.1 s")
        for interval in ("0.02", "0.005", "0.001")
    }
    for name in ("constant", "ramp to 0", "ramp 75 to 25 %"):
        aims[f"closed loop: {name}"] = Aim(mae=0.05)
    aims["closed loop: full drop"] = Aim(mae=0.05, detection_s=0.3)
    aims["closed loop: one-point step"] = Aim(mae=0.05, detection_s=1.5)
    aims["warm-up 30 %, own plant"] = Aim(false_drop=0.1)
    aims["warm-up 30 %, one encoder"] = Aim(coverage=0.95, misleading=0.0)
    aims["40 min: warm-up, slow loss, step"] = Aim(mae=0.05, worst=0.15, detection_s=60.0)
    for name in ("payload +10 kg", "relubrication of the nut", "process force"):
        aims[f"{name}, own plant"] = Aim(false_drop=0.3)
    return aims | _foreign_aims() | _error_aims()


def _foreign_aims() -> dict[str, Aim]:
    aims = {f"{_FOREIGN}all scenarios": Aim(mae=0.25, interval_score=2.0)}
    plain = ("healthy", "ramp to 0", "ramp 75 to 25 %", "full drop", "one-point step")
    aims |= {_FOREIGN + name: Aim() for name in (*plain, "constant 2 %", "constant 0 %")}
    aims[_FOREIGN + "full drop"] = Aim(detection_s=2.0)
    aims[_FOREIGN + "warm-up"] = Aim(false_drop=0.1)
    forces = (f"process force {share} % of the time" for share in (30, 40))
    for name in ("payload +10 kg", "relubrication", *forces):
        aims[_FOREIGN + name] = Aim(false_drop=0.3)
    aims[_FOREIGN + "warm-up, one encoder"] = Aim(coverage=0.95, misleading=0.0)
    return aims


def _error_aims() -> dict[str, Aim]:
    exact, *wrong = (row for row, _ in ERRORS)
    limits = (0.1, 0.1, 0.1, 0.3)
    aims = {exact: Aim()}
    aims |= {
        row: Aim(added=limit, reference=exact) for row, limit in zip(wrong, limits, strict=True)
    }
    base = f"{_FOREIGN}no error"
    aims[base] = Aim()
    for name, limit in zip(("torque_gain", "inertia", "skew_s", "series"), limits, strict=True):
        aims[f"{_FOREIGN}{name} error"] = Aim(added=limit, reference=base)
    return aims | {case.name: Aim(misleading=0.0) for case in CASES}


_SPOILED = frozenset(case.name for case in CASES)
AIMS = _aims()


@dataclass(frozen=True, slots=True)
class BenchRow:
    """One row as measured; `ours` is None where it could not be."""

    row: str
    ours: Score | None
    seed: Score | None
    aim: str
    met: bool | None
    added: float | None


@dataclass(frozen=True, slots=True)
class BenchTable:
    """All rows, in order."""

    rows: tuple[BenchRow, ...]

    def as_text(self) -> str:
        """For a terminal."""
        heads = ("row", "seed MAE", "MAE", "worst", "drop", "cover", "score", "seen s")
        lines = [_line(heads, "aim", "met")]
        lines += [_line(_cells(row), _remark(row), _met(row)) for row in self.rows]
        judged = [row.met for row in self.rows if row.met is not None]
        lines.append(f"{sum(judged)} of {len(judged)} aims met")
        return "\n".join(lines)

    def as_json(self) -> str:
        """For a program; what is not a number is null."""
        rows = _jsonable([asdict(row) for row in self.rows])
        return json.dumps({"schema": "estimator-bench/1", "rows": rows}, indent=2, allow_nan=False)


def table_of(parts: Sequence[Part]) -> BenchTable:
    """Pool the parts of each row and hold them against the aims."""
    ours = _pooled_by_row(parts, lambda part: part.ours)
    seed = _pooled_by_row(parts, lambda part: part.seed)
    rows = [_row(name, aim, ours, seed) for name, aim in AIMS.items()]
    return BenchTable((*rows, _coverage_row(rows)))


def _pooled_by_row(parts: Sequence[Part], pick: Callable[[Part], Score | None]) -> dict[str, Score]:
    found: dict[str, list[Score]] = {}
    for part in parts:
        one = pick(part)
        if one is None:
            continue
        found.setdefault(part.row, []).append(one)
        if part.row.startswith(_FOREIGN) and not part.row.endswith((" error", "one encoder")):
            found.setdefault(f"{_FOREIGN}all scenarios", []).append(one)
    return {row: pooled(scores) for row, scores in found.items()}


def _row(name: str, aim: Aim, ours: Mapping[str, Score], seed: Mapping[str, Score]) -> BenchRow:
    mine, text = ours.get(name), aim.text()
    if mine is None:
        return BenchRow(name, None, None, text or "-", None, None)
    reference = ours.get(aim.reference or "")
    added = None if reference is None else mine.mae - reference.mae
    met = aim.met(mine, reference) if text else None
    return BenchRow(name, mine, seed.get(name), text, met, added)


def _coverage_row(rows: Sequence[BenchRow]) -> BenchRow:
    """How many rows have honest intervals, too wide ones counted as missed."""
    told = [row.ours.coverage for row in rows if row.ours and not math.isnan(row.ours.coverage)]
    low, high = COVERAGE
    honest = sum(low <= each <= high for each in told)
    name = f"coverage: {honest} rows of {len(told)} within, {sum(c > high for c in told)} above"
    return BenchRow(name, None, None, f"each within {low:g} to {high:g}", honest == len(told), None)


def _line(cells: Sequence[str], aim: str, met: str) -> str:
    first, *numbers = cells
    return f"{first:<44}" + "".join(f"{cell:>9}" for cell in numbers) + f"  {met:<7} {aim}"


def _cells(row: BenchRow) -> tuple[str, ...]:
    ours, seed = row.ours, row.seed
    if ours is None:
        return (row.row, *["-"] * 7)
    figures = (
        math.nan if seed is None else seed.mae,
        ours.mae,
        ours.worst,
        ours.false_drop,
        ours.coverage,
        ours.interval_score,
        ours.detection_s,
    )
    return (row.row, *(_number(figure) for figure in figures))


def _remark(row: BenchRow) -> str:
    """The aim, what was added, and for spoiled recordings what was said."""
    remark = row.aim or "-"
    if row.added is not None:
        remark += f"; added {row.added:+.3f}"
    if row.ours is not None and row.row in _SPOILED:
        remark += f"; misleading {row.ours.misleading:.1%}; {', '.join(row.ours.notes)}"
    return remark


def _number(figure: float) -> str:
    if math.isnan(figure):
        return "-"
    return "never" if math.isinf(figure) else f"{figure:.3f}"


def _met(row: BenchRow) -> str:
    if row.met is None:
        return "-" if row.ours is not None else "no data"
    return "yes" if row.met else "MISSED"


def _jsonable(value: object) -> object:
    if isinstance(value, dict):
        return {name: _jsonable(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "never"
    return value
