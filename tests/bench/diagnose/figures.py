"""Figures of the benches of the diagnosis: counts of cases beside their aims."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from ..table import Table

Row = tuple[str, str, str]
"""Figure, aim, and what was reached of how many."""


def share(name: str, aim: str, cases: Iterable[Any], holds: Callable[[Any], bool] = bool) -> Row:
    """Count of the cases for which something holds."""
    found = [holds(case) for case in cases]
    return name, aim, f"{sum(found)} of {len(found)}" if found else "-"


def value(name: str, aim: str, reached: float, count: int, unit: str = "") -> Row:
    """A number from so many cases; with unit % as a percentage."""
    text = f"{100.0 * reached:.1f} %" if unit == "%" else f"{reached:.3f}"
    return name, aim, f"{text}, of {count}" if count else "-"


def figures_table(rows: Sequence[Row], notes: Sequence[str] = ()) -> Table:
    return Table(("figure", "aim", "reached"), tuple(rows), tuple(notes))
