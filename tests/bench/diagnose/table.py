"""Results of a bench of the diagnosis: figures, confusion, and what each effect gave."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from ..table import MISSING, markdown
from .confusion import by_strength, confusion_matrix, verdicts_of_each
from .rows import (
    LARGE,
    SURE,
    WEAK,
    BenchRow,
    are_all_named,
    are_two_named,
    clear_rows,
    is_confident_and_wrong,
    is_exact,
    is_first,
    is_known,
    is_place_right,
    is_sure,
    weak_rows,
)


@dataclass(frozen=True, slots=True)
class BenchFigure:
    """One line of the table."""

    name: str
    aim: str
    reached: float
    count: int
    unit: str = ""

    @property
    def cells(self) -> tuple[str, str, str]:
        """The line of the table; a share is written as a count of cases."""
        match self.unit:
            case "":
                reached = f"{round(self.reached * self.count)} of {self.count}"
            case "%":
                reached = f"{100.0 * self.reached:.1f} %, of {self.count}"
            case _:
                reached = f"{self.reached:.3f}, of {self.count}"
        return self.name, self.aim, reached if self.count else MISSING


def figures_as_text(figures: Iterable[BenchFigure]) -> list[str]:
    """Lines of a table in Markdown."""
    return markdown(("figure", "aim", "reached"), [figure.cells for figure in figures])


def figures_of(rows: Sequence[BenchRow]) -> list[BenchFigure]:
    """The figures of the issue's table that the rows can fill."""
    singles = [r for r in rows if len(r.case.causes) == 1 and is_known(r) and not r.case.withheld]
    full = [r for r in singles if r.case.motion == "full"]
    work = [r for r in singles if r.case.motion == "production"]
    pairs = [r for r in rows if len(r.case.causes) == 2]
    triples = [r for r in rows if len(r.case.causes) == 3]
    healthy = [r for r in rows if not r.case.causes]
    odd = [r for r in rows if r.case.causes and not is_known(r)]
    out = [r for r in rows if r.case.withheld]
    return [
        _share("top-1, full protocol, clear gap", "99 %", clear_rows(full), is_first),
        _share("top-1, full protocol, weak gap", "93 %", weak_rows(full), is_first),
        _share("top-1, production, clear gap", "98 %", clear_rows(work), is_first),
        _share("top-1, production, weak gap", "", weak_rows(work), is_first),
        _share("single: no other effect named", "", clear_rows(singles), is_exact),
        _share("pairs: both named", "97 %", pairs, are_all_named),
        _share("pairs: exact set", "90 %", pairs, is_exact),
        _share("triples: at least two named", "99 %", triples, are_two_named),
        _share("healthy falsely attributed", "<= 0.5 %", healthy, lambda r: bool(r.named)),
        _share("never in the library: named with confidence", "<= 5 %", odd, is_sure),
        _share("left out of the library: named with confidence", "<= 8 %", out, is_sure),
        _share("confident and wrong", "<= 1 %", rows, is_confident_and_wrong),
        _auroc(singles, odd),
        _calibration(rows),
        _share("where: right variable, clear gap", "98 %", clear_rows(singles), is_place_right),
        _overlap(rows),
        *_shrinks(rows),
    ]


def _auroc(known: Iterable[BenchRow], odd: Iterable[BenchRow]) -> BenchFigure:
    """Chance that a cause of the library is named with more probability than one that is not."""
    named = [_most(row) for row in known if row.ratio >= WEAK]
    other = [_most(row) for row in odd if row.ratio >= WEAK]
    pairs = [(a > b) + 0.5 * (a == b) for a in named for b in other]
    name = "never in the library, told by the probability: AUROC"
    return BenchFigure(name, ".99", sum(pairs) / max(len(pairs), 1), len(pairs), "1")


def _most(row: BenchRow) -> float:
    return max(row.named.values(), default=0.0)


def reliability(rows: Iterable[BenchRow]) -> list[tuple[float, float, int]]:
    """Mean probability, frequency of being right, and count of the names in each tenth."""
    bins: dict[int, list[tuple[float, bool]]] = {}
    for row in rows:
        there = set(row.case.causes) - set(row.case.withheld)
        for name, p in row.named.items():
            bins.setdefault(min(int(10.0 * p), 9), []).append((p, name in there))
    return [
        (sum(p for p, _ in each) / len(each), sum(y for _, y in each) / len(each), len(each))
        for _, each in sorted(bins.items())
    ]


def _calibration(rows: Iterable[BenchRow]) -> BenchFigure:
    """Mean distance of probability and frequency over ten bins of probability."""
    bins = reliability(rows)
    count = sum(n for _, _, n in bins)
    off = sum(n * abs(p - y) for p, y, n in bins) / max(count, 1)
    return BenchFigure("calibration error of the probabilities", "<= .03", off, count, "1")


def _overlap(rows: Iterable[BenchRow]) -> BenchFigure:
    covered = [row.covered for row in rows if row.covered is not None]
    mean = sum(covered) / max(len(covered), 1)
    name = f"where: overlap of the intervals, gap of {LARGE:g} floors"
    return BenchFigure(name, ".88", mean, len(covered), "1")


def _shrinks(rows: Sequence[BenchRow]) -> list[BenchFigure]:
    """Predicted against realised shrink of what is rightly named with confidence."""
    pairs = [
        (row.shrink[name], row.realised[name])
        for row in rows
        for name, p in row.named.items()
        if p > SURE and name in row.case.causes and name != "external_force"
    ]
    off = sorted(abs(shrink[0] - realised) for shrink, realised in pairs)
    inside = [shrink[1] <= realised <= shrink[2] for shrink, realised in pairs]
    count, possible = len(off), _of_possible(rows)
    return [
        BenchFigure(
            "shrink, predicted less realised: median", "2 %", _quantile(off, 0.5), count, "%"
        ),
        BenchFigure(
            "shrink, predicted less realised: 95th of 100", "6 %", _quantile(off, 0.95), count, "%"
        ),
        BenchFigure(
            "shrink: 90 % interval holds what is realised",
            "85-95 %",
            sum(inside) / max(count, 1),
            count,
        ),
        BenchFigure(
            "shrink realised of what could shrink: median",
            "97 %",
            _quantile(possible, 0.5),
            len(possible),
            "%",
        ),
    ]


def _of_possible(rows: Iterable[BenchRow]) -> list[float]:
    """(before - after) / (before - floor) of another recording, where all that is named is there.

    An external force is left out: it does not come again.
    """
    return sorted(
        (before - after) / (before - row.gap[name][2])
        for row in rows
        if row.named and set(row.named) <= set(row.case.causes) - {"external_force"}
        for name, (before, after) in row.again.items()
        if before > WEAK * row.gap[name][2]
    )


def _quantile(ordered: Sequence[float], level: float) -> float:
    return ordered[min(int(level * len(ordered)), len(ordered) - 1)] if ordered else 0.0


def _share(
    name: str, aim: str, rows: Iterable[BenchRow], test: Callable[[BenchRow], bool]
) -> BenchFigure:
    found = [test(row) for row in rows]
    return BenchFigure(name, aim, sum(found) / max(len(found), 1), len(found))


def as_text(rows: Sequence[BenchRow]) -> str:
    """Figures, top-1 by strength, the confusion matrix, and what was said in each case."""
    parts = [
        figures_as_text(figures_of(rows)),
        ["top-1 of single causes by strength", *by_strength(rows)],
        ["what is there (rows) against what leads the answer (columns)", *confusion_matrix(rows)],
        ["verdict and names, by cause", *verdicts_of_each(rows)],
    ]
    return "\n\n".join("\n".join(part) for part in parts)
