"""Counts of what the diagnosis said of the foreign plant's cases, beside the aims."""

from collections import Counter
from collections.abc import Iterable, Sequence

from edge_service.models.effects.registry import effect_names

from ..table import Progress, Table
from .figures import Row, figures_table, share, value
from .foreign import LARGE, BenchRow, plan_cases, run_cases

SURE, LIKELY = 0.9, 0.5
CLEAR, WEAK = 3.0, 1.5
"""Gap over that of a healthy axis from which on a case is clear, and weak."""
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
    """Return whether the gap is said to live over the variable that its cause is a function of."""
    right = RIGHT_VARIABLES.get(row.case.causes[0])
    return right is None or bool({place.split(":")[1] for place in row.where[:1]} & right)


def is_first(row: BenchRow) -> bool:
    """Return whether the cause, or one that is named as tied with it, leads the list."""
    first = max(row.named, key=lambda name: row.named[name], default=None)
    if first is None:
        return False
    leaders = [n for n, p in row.named.items() if p >= row.named[first] - 1e-3]
    if first not in row.case.causes and set(leaders) & set(row.case.causes):
        first = max(leaders, key=lambda n: row.shrink[n][0])
    return bool({first, *row.classes[first]} & set(row.case.causes))


def likely(row: BenchRow) -> set[str]:
    """Names that are likely."""
    return {name for name, p in row.named.items() if p > LIKELY}


def are_all_named(row: BenchRow) -> bool:
    """Return whether every cause is likely."""
    return set(row.case.causes) <= likely(row)


def is_sure(row: BenchRow) -> bool:
    """Return whether anything is named with confidence."""
    return any(p > SURE for p in row.named.values())


def is_confident_and_wrong(row: BenchRow) -> bool:
    """Return whether something is named with confidence that was not there."""
    there = set(row.case.causes) - set(row.case.withheld)
    return any(p > SURE and name not in there for name, p in row.named.items())


def figures_of(rows: Sequence[BenchRow]) -> list[Row]:
    """All figures that the rows can fill."""
    known = [r for r in rows if set(r.case.causes) <= set(effect_names())]
    singles = [r for r in known if len(r.case.causes) == 1 and not r.case.withheld]
    clear = [r for r in singles if r.ratio >= CLEAR]
    weak = [r for r in singles if WEAK <= r.ratio < CLEAR]
    pairs = [r for r in rows if len(r.case.causes) == 2]
    triples = [r for r in rows if len(r.case.causes) == 3]
    healthy = [r for r in rows if not r.case.causes]
    odd = [r for r in rows if r not in known]
    out = [r for r in rows if r.case.withheld]

    def of(motion: str, group: Sequence[BenchRow]) -> list[BenchRow]:
        return [row for row in group if row.case.motion == motion]

    bins = reliability(rows)
    count = sum(n for _, _, n in bins)
    off = sum(n * abs(p - y) for p, y, n in bins) / max(count, 1)
    covered = [row.covered for row in rows if row.covered is not None]
    overlap = sum(covered) / max(len(covered), 1)
    return [
        share("first, full protocol, clear gap", "99 %", of("full", clear), is_first),
        share("first, full protocol, weak gap", "93 %", of("full", weak), is_first),
        share("first, production, clear gap", "98 %", of("production", clear), is_first),
        share("first, production, weak gap", "", of("production", weak), is_first),
        share("pairs: both named", "97 %", pairs, are_all_named),
        share(
            "triples: at least two named",
            "99 %",
            triples,
            lambda row: len(likely(row) & set(row.case.causes)) >= 2,
        ),
        share("healthy falsely attributed", "<= 0.5 %", healthy, lambda row: bool(row.named)),
        share("never in the library: named with confidence", "<= 5 %", odd, is_sure),
        share("left out of the library: named with confidence", "<= 8 %", out, is_sure),
        share("confident and wrong", "<= 1 %", rows, is_confident_and_wrong),
        value("calibration error of the probabilities", "<= .03", off, count),
        share("where: right variable, clear gap", "98 %", clear, is_place_right),
        value(f"where: overlap, gap of {LARGE:g} floors", ".88", overlap, len(covered)),
        *_shrinks(rows),
    ]


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


def _shrinks(rows: Sequence[BenchRow]) -> list[Row]:
    """Predicted against realised shrink of what is rightly named with confidence.

    An external force is left out: it does not come again.
    """
    pairs = [
        (row.shrink[name], row.realised[name])
        for row in rows
        for name, p in row.named.items()
        if p > SURE and name in row.case.causes and name != "external_force"
    ]
    off = sorted(abs(shrink[0] - realised) for shrink, realised in pairs)
    possible = sorted(
        (before - after) / (before - row.gap[name][2])
        for row in rows
        if row.named and set(row.named) <= set(row.case.causes) - {"external_force"}
        for name, (before, after) in row.again.items()
        if before > WEAK * row.gap[name][2]
    )
    name, count = "shrink, predicted less realised", len(off)
    return [
        value(f"{name}: median", "2 %", _quantile(off, 0.5), count, "%"),
        value(f"{name}: 95th of 100", "6 %", _quantile(off, 0.95), count, "%"),
        share(
            "shrink: 90 % interval holds what is realised",
            "85-95 %",
            pairs,
            lambda pair: pair[0][1] <= pair[1] <= pair[0][2],
        ),
        value(
            "shrink realised of what could shrink: median",
            "97 %",
            _quantile(possible, 0.5),
            len(possible),
            "%",
        ),
    ]


def _quantile(ordered: Sequence[float], level: float) -> float:
    return ordered[min(int(level * len(ordered)), len(ordered) - 1)] if ordered else 0.0


def verdicts_of_each(rows: Sequence[BenchRow]) -> list[str]:
    """Healthy, single and withheld causes -> verdicts with all names, one line each."""
    said: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row.case.causes) < 2:
            cause = row.case.causes[0] if row.case.causes else "healthy"
            label = f"no {cause}" if row.case.withheld else cause
            names = "+".join(sorted(row.named)) or "nothing"
            said.setdefault(label, Counter())[f"{row.verdict}:{names}"] += 1
    return [
        f"{label:<30} {', '.join(f'{what} {count}' for what, count in each.most_common())}"
        for label, each in sorted(said.items())
    ]


def run_foreign(count: int, seed: int, progress: Progress) -> Table:
    """Run a mixture of `count` cases; below the figures what was said of each cause."""
    rows = list(run_cases(plan_cases(count, seed), progress))
    notes = ("", "verdict and names, by cause", *verdicts_of_each(rows))
    return figures_table(figures_of(rows), notes)
