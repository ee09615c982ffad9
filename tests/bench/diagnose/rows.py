"""Outcome of each case, kept as a line of JSON."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from .cases import BenchCase, BenchError

LARGE = 10.0
"""Gap over that of a healthy axis from which on intervals are held against the truth."""


@dataclass(frozen=True, slots=True)
class BenchRow:
    """Outcome of a case.

    Attributes:
        named: effect -> probability.
        shrink: effect -> estimate, low, high.
        realised: effect -> how far it shrinks the gap of another recording of the same axis.
        gap: channel -> before, after, of a healthy axis.
        where: channel and variable, the best first.
        covered: overlap of named and true intervals; None where there is nothing to compare.
        again: channel -> gap of that other recording before, and with all named effects.
    """

    case: BenchCase
    verdict: str
    named: dict[str, float]
    classes: dict[str, list[str]]
    ratio: float
    unexplained: float
    shrink: dict[str, tuple[float, float, float]]
    realised: dict[str, float]
    gap: dict[str, tuple[float, float, float]]
    where: list[str]
    seconds: float
    covered: float | None = None
    again: dict[str, tuple[float, float]] = field(default_factory=dict)


def read_rows(path: Path) -> list[BenchRow]:
    """Rows of an earlier run; none where there is no file. A line cut short ends them.

    Raises:
        BenchError: a line holds something else.
    """
    rows: list[BenchRow] = []
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    for number, line in enumerate(lines, start=1):
        try:
            known = json.loads(line)
        except ValueError:
            break
        try:
            rows.append(_read(known))
        except (KeyError, TypeError, AttributeError):
            raise BenchError(f"{path}: line {number} is no case of bench diagnose") from None
    return rows


def _read(known: dict[str, Any]) -> BenchRow:
    case = known.pop("case")
    for key in ("causes", "withheld"):
        case[key] = tuple(case[key])
    known["shrink"] = {name: tuple(values) for name, values in known["shrink"].items()}
    for key in ("gap", "again"):
        known[key] = {name: tuple(values) for name, values in known.get(key, {}).items()}
    return BenchRow(case=BenchCase(**case), **known)


def write_rows(rows: Iterable[BenchRow], out: Path, mode: str) -> None:
    """One JSON object per line."""
    with out.open(mode, encoding="utf-8") as file:
        for row in rows:
            file.write(json.dumps(asdict(row)) + "\n")


SURE = 0.9
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
    """Tell whether the gap is said to live over the variable that its cause is a function of."""
    right = RIGHT_VARIABLES.get(row.case.causes[0])
    return right is None or bool({place.split(":")[1] for place in row.where[:1]} & right)


def is_known(row: BenchRow) -> bool:
    from edge_service.models.effects.registry import effect_names

    return all(cause in effect_names() for cause in row.case.causes)


def clear_rows(rows: Iterable[BenchRow]) -> list[BenchRow]:
    return [row for row in rows if row.ratio >= CLEAR]


def weak_rows(rows: Iterable[BenchRow]) -> list[BenchRow]:
    return [row for row in rows if WEAK <= row.ratio < CLEAR]


def is_first(row: BenchRow) -> bool:
    """Tell whether the cause, or one that is named as tied with it, leads the list."""
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
