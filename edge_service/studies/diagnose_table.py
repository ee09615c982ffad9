"""Results of a bench of the diagnosis: figures, confusion, and what each effect gave."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from .diagnose_bench import LARGE, BenchRow

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
    unit: str = ""

    def as_text(self) -> str:
        """The line, in Markdown; a share is told as a count of cases."""
        match self.unit:
            case "":
                reached = f"{round(self.reached * self.count)} of {self.count}"
            case "%":
                reached = f"{100.0 * self.reached:.1f} %, of {self.count}"
            case _:
                reached = f"{self.reached:.3f}, of {self.count}"
        return f"| {self.name} | {self.aim} | {reached if self.count else '-'} |"


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
        _auroc(singles, odd),
        _calibration(rows),
        _share("where: right variable, clear gap", "98 %", _clear(singles), is_place_right),
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


RIGHT_VARIABLES = {
    "inertia_error": {"motor_acceleration_rad_s2"},
    "viscous_error": {"motor_speed_rad_s"},
    "quadratic_friction": {"motor_speed_rad_s"},
    "stribeck": {"motor_speed_rad_s"},
    "drag_error": {"direction", "motor_speed_rad_s"},
    "load_friction": {"direction", "motor_acceleration_rad_s2"},
    "position_friction": {"table_position_m"},
    "backlash": {"direction"},
    "compliance": {"motor_acceleration_rad_s2", "direction", "motor_speed_rad_s"},
    "lead_error": {"table_position_m", "motor_angle_rad"},
    "thermal_growth": {"time_s", "temperature_c", "table_position_m"},
    "warmup": {"time_s", "temperature_c"},
    "external_force": {"time_s"},
    "torque_ripple": {"motor_angle_rad"},
    "once_per_rev_friction": {"motor_angle_rad"},
    "encoder_eccentricity": {"motor_angle_rad"},
    "timestamp_skew": {"motor_speed_rad_s"},
}
"""Over what the gap of a cause is a function; the others leave several answers open."""


def is_place_right(row: BenchRow) -> bool:
    """Tell whether the gap is said to live over the variable that its cause is a function of."""
    right = RIGHT_VARIABLES.get(row.case.causes[0])
    return right is None or bool({place.split(":")[1] for place in row.where[:1]} & right)


def _share(
    name: str, aim: str, rows: Iterable[BenchRow], test: Callable[[BenchRow], bool]
) -> BenchFigure:
    found = [test(row) for row in rows]
    return BenchFigure(name, aim, sum(found) / max(len(found), 1), len(found))


def is_known(row: BenchRow) -> bool:
    from ..models.effects.registry import effect_names

    return all(cause in effect_names() for cause in row.case.causes)


def _clear(rows: Iterable[BenchRow]) -> list[BenchRow]:
    return [row for row in rows if row.ratio >= CLEAR]


def _weak(rows: Iterable[BenchRow]) -> list[BenchRow]:
    return [row for row in rows if WEAK <= row.ratio < CLEAR]


def is_first(row: BenchRow) -> bool:
    """Tell whether the cause, or one that is told to be tied with it, leads the list."""
    first = max(row.named, key=lambda name: row.named[name], default=None)
    if first is None:
        return False
    leaders = [n for n, p in row.named.items() if p >= row.named[first] - 1e-3]
    if first not in row.case.causes and set(leaders) & set(row.case.causes):
        first = max(leaders, key=lambda n: row.shrink[n][0])
    return bool({first, *row.classes[first]} & set(row.case.causes))


def is_exact(row: BenchRow) -> bool:
    """Tell whether what is likely is what was there."""
    return {name for name, p in row.named.items() if p > 0.5} == set(row.case.causes)


def are_all_named(row: BenchRow) -> bool:
    """Tell whether every cause is likely."""
    return all(row.named.get(cause, 0.0) > 0.5 for cause in row.case.causes)


def are_two_named(row: BenchRow) -> bool:
    """Tell whether at least two causes are likely."""
    return sum(row.named.get(cause, 0.0) > 0.5 for cause in row.case.causes) >= 2


def is_sure(row: BenchRow) -> bool:
    """Tell whether anything is named with confidence."""
    return any(p > SURE for p in row.named.values())


def is_confident_and_wrong(row: BenchRow) -> bool:
    """Tell whether something is named with confidence that was not there."""
    there = set(row.case.causes) - set(row.case.withheld)
    return any(p > SURE and name not in there for name, p in row.named.items())


def as_text(rows: Sequence[BenchRow]) -> str:
    """Figures, top-1 by strength, the confusion matrix, and what was said in each case."""
    from .diagnose_confusion import by_strength, confusion_matrix, told_of_each

    parts = [
        [
            "| figure | aim | reached |",
            "|---|---|---|",
            *(figure.as_text() for figure in figures_of(rows)),
        ],
        ["top-1 of single causes by strength", *by_strength(rows)],
        ["what is there (rows) against what leads the answer (columns)", *confusion_matrix(rows)],
        ["verdict and names, by cause", *told_of_each(rows)],
    ]
    return "\n\n".join("\n".join(part) for part in parts)
