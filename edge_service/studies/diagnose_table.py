"""What a bench of the diagnosis reached: figures, confusion, and what each effect gave."""

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from .diagnose_bench import BenchRow

SURE = 0.9
CLEAR, WEAK = 3.0, 1.5
"""Gap over that of a healthy axis from which on a case is clear, and weak."""


@dataclass(frozen=True, slots=True)
class BenchFigure:
    """One line of the table."""

    name: str
    aim: str
    reached: float
    count: int

    def as_text(self) -> str:
        """The line."""
        reached = f"{100.0 * self.reached:5.1f} %" if self.count else "   -   "
        return f"{self.name:<58} {self.aim:>9} {reached} of {self.count}"


def figures_of(rows: Sequence[BenchRow]) -> list[BenchFigure]:
    """The figures of the issue's table that the rows can fill."""
    singles = [r for r in rows if len(r.case.causes) == 1 and _is_known(r) and not r.case.withheld]
    full = [r for r in singles if r.case.motion == "full"]
    work = [r for r in singles if r.case.motion == "production"]
    pairs = [r for r in rows if len(r.case.causes) == 2]
    triples = [r for r in rows if len(r.case.causes) == 3]
    healthy = [r for r in rows if not r.case.causes]
    odd = [r for r in rows if r.case.causes and not _is_known(r)]
    out = [r for r in rows if r.case.withheld]
    return [
        _share("top-1, full protocol, clear gap", "99 %", _clear(full), is_first),
        _share("top-1, full protocol, weak gap", "93 %", _weak(full), is_first),
        _share("top-1, production, clear gap", "98 %", _clear(work), is_first),
        _share("top-1, production, weak gap", "", _weak(work), is_first),
        _share("single: no other effect named", "", _clear(singles), is_exact),
        _share("pairs: both named", "97 %", pairs, are_all_named),
        _share("pairs: exact set", "90 %", pairs, is_exact),
        _share("triples: at least two named", "99 %", triples, are_two_named),
        _share("healthy falsely attributed", "<= 0.5 %", healthy, lambda r: bool(r.named)),
        _share("never in the library: named with confidence", "<= 5 %", odd, is_sure),
        _share("left out of the library: named with confidence", "<= 8 %", out, is_sure),
        _share("confident and wrong", "<= 1 %", rows, is_confident_and_wrong),
    ]


def _share(
    name: str, aim: str, rows: Iterable[BenchRow], test: Callable[[BenchRow], bool]
) -> BenchFigure:
    found = [test(row) for row in rows]
    return BenchFigure(name, aim, sum(found) / max(len(found), 1), len(found))


def _is_known(row: BenchRow) -> bool:
    from ..models.effects.registry import effect_names

    return all(cause in effect_names() for cause in row.case.causes)


def _clear(rows: Iterable[BenchRow]) -> list[BenchRow]:
    return [row for row in rows if row.ratio >= CLEAR]


def _weak(rows: Iterable[BenchRow]) -> list[BenchRow]:
    return [row for row in rows if WEAK <= row.ratio < CLEAR]


def is_first(row: BenchRow) -> bool:
    """Whether the cause, or one that is told to be tied with it, leads the list."""
    first = max(row.named, key=lambda name: row.named[name], default=None)
    if first is None:
        return False
    leaders = [n for n, p in row.named.items() if p >= row.named[first] - 1e-3]
    if first not in row.case.causes and set(leaders) & set(row.case.causes):
        first = max(leaders, key=lambda n: row.shrink.get(n, 0.0))
    return bool({first, *row.classes[first]} & set(row.case.causes))


def is_exact(row: BenchRow) -> bool:
    """Whether what is likely is what was there."""
    return {name for name, p in row.named.items() if p > 0.5} == set(row.case.causes)


def are_all_named(row: BenchRow) -> bool:
    """Whether every cause is likely."""
    return all(row.named.get(cause, 0.0) > 0.5 for cause in row.case.causes)


def are_two_named(row: BenchRow) -> bool:
    """Whether two causes are likely."""
    return sum(row.named.get(cause, 0.0) > 0.5 for cause in row.case.causes) >= 2


def is_sure(row: BenchRow) -> bool:
    """Whether anything is named with confidence."""
    return any(p > SURE for p in row.named.values())


def is_confident_and_wrong(row: BenchRow) -> bool:
    """Whether something is named with confidence that was not there."""
    there = set(row.case.causes) - set(row.case.withheld)
    return any(p > SURE and name not in there for name, p in row.named.items())


def confusion(rows: Sequence[BenchRow]) -> list[str]:
    """Single causes -> what came of them, one line each."""
    lines = []
    kinds = {(row.case.causes, row.case.withheld) for row in rows if len(row.case.causes) < 2}
    for causes, withheld in sorted(kinds):
        mine = [r for r in rows if (r.case.causes, r.case.withheld) == (causes, withheld)]
        told = Counter(f"{row.verdict}:{'+'.join(sorted(row.named)) or 'nothing'}" for row in mine)
        label = ("no " if withheld else "") + (causes[0] if causes else "healthy")
        parts = ", ".join(f"{what} {count}" for what, count in told.most_common())
        lines.append(f"{label:<26} {parts}")
    return lines


def as_text(rows: Sequence[BenchRow]) -> str:
    """Table and confusion."""
    return "\n".join([*(figure.as_text() for figure in figures_of(rows)), "", *confusion(rows)])
