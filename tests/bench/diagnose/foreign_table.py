"""`edge-service check-diagnosis` at length: answers to a foreign plant's cases beside the aims."""

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial

from edge_service.models.effects.registry import effect_names
from edge_service.offline.diagnosis.check import (
    CheckedCase,
    HiddenCase,
    calibration_error,
    checked,
    foreign_plant,
    plan,
    shrinks_of,
)

from ..table import Progress, Table, in_processes
from .figures import Row, figures_table, share, value

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


def is_place_right(row: CheckedCase) -> bool:
    """Return whether the gap is said to live over the variable that its cause is a function of."""
    right = RIGHT_VARIABLES.get(row.case.causes[0])
    return right is None or bool({place.variable for place in row.found.where[:1]} & right)


def is_first(row: CheckedCase) -> bool:
    """Return whether the cause, or one that is named as tied with it, leads the list."""
    first = max(row.named, key=lambda name: row.named[name], default=None)
    if first is None:
        return False
    leaders = [n for n, p in row.named.items() if p >= row.named[first] - 1e-3]
    if first not in row.case.causes and set(leaders) & set(row.case.causes):
        first = max(leaders, key=lambda n: row.shrink[n].estimate)
    return bool({first, *row.tied[first]} & set(row.case.causes))


def are_all_named(row: CheckedCase) -> bool:
    """Return whether every cause is likely."""
    return row.case.names <= row.likely


def figures_of(rows: Sequence[CheckedCase]) -> list[Row]:
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

    def of(motion: str, group: Sequence[CheckedCase]) -> list[CheckedCase]:
        return [row for row in group if row.case.motion == motion]

    off, count = calibration_error(rows)
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
            lambda row: len(row.likely & row.case.names) >= 2,
        ),
        share("healthy falsely attributed", "<= 0.5 %", healthy, lambda row: bool(row.named)),
        share(
            "never in the library: named with confidence", "<= 5 %", odd, lambda row: row.is_sure
        ),
        share(
            "left out of the library: named with confidence", "<= 8 %", out, lambda row: row.is_sure
        ),
        share("confident and wrong", "<= 1 %", rows, lambda row: row.is_wrong),
        value("calibration error of the probabilities", "<= .03", off, count),
        share("where: right variable, clear gap", "98 %", clear, is_place_right),
        *_shrinks(rows),
    ]


def _shrinks(rows: Sequence[CheckedCase]) -> list[Row]:
    """Predicted against realised shrink, also of all that could shrink."""
    pairs = shrinks_of(rows)
    off = sorted(abs(shrink.estimate - realised) for shrink, realised in pairs)
    possible = sorted(
        (before - after) / (before - row.found.gap[name].floor)
        for row in rows
        if row.named and set(row.named) <= row.case.names - {"external_force"}
        for name, (before, after) in row.again.items()
        if name in {each.channel for each in row.found.effects}
        and before > WEAK * row.found.gap[name].floor
    )
    name, count = "shrink, predicted less realised", len(off)
    return [
        value(f"{name}: median", "2 %", _quantile(off, 0.5), count, "%"),
        value(f"{name}: 95th of 100", "6 %", _quantile(off, 0.95), count, "%"),
        share(
            "shrink: 90 % interval holds what is realised",
            "85-95 %",
            pairs,
            lambda pair: pair[0].low <= pair[1] <= pair[0].high,
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


def verdicts_of_each(rows: Sequence[CheckedCase]) -> list[str]:
    """Healthy, single and withheld causes -> verdicts with all names, one line each."""
    said: dict[str, Counter[str]] = {}
    for row in rows:
        if len(row.case.causes) < 2:
            cause = row.case.causes[0] if row.case.causes else "healthy"
            label = f"no {cause}" if row.case.withheld else cause
            names = "+".join(sorted(row.named)) or "nothing"
            said.setdefault(label, Counter())[f"{row.found.verdict.value}:{names}"] += 1
    return [
        f"{label:<30} {', '.join(f'{what} {count}' for what, count in each.most_common())}"
        for label, each in sorted(said.items())
    ]


def run_cases(cases: Sequence[HiddenCase], progress: Progress) -> Iterator[CheckedCase]:
    """All cases over some processes, as they are done."""
    jobs = [partial(checked, foreign_plant(), case) for case in cases]
    for count, (_, row) in enumerate(in_processes(jobs), start=1):
        progress(f"{count} of {len(cases)}: {row.words}")
        yield row


def run_foreign(count: int, seed: int, progress: Progress) -> Table:
    """Run a mixture of `count` cases; below the figures what was said of each cause."""
    rows = list(run_cases(plan(foreign_plant(), count, seed), progress))
    notes = ("", "verdict and names, by cause", *verdicts_of_each(rows))
    return figures_table(figures_of(rows), notes)
