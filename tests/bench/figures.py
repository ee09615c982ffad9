"""The figures of a bench, beside their aims, as a table and as JSON-able values."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

Progress = Callable[[str], None]
"""Takes a line that says how far it is."""
_HEADINGS = ("figure", "value", "unit", "aim", "met")


class PipelineBenchError(Exception):
    """A measurement that could not be made; the text is one line."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One measured number.

    Attributes
    ----------
    key : str
        Its name in JSON.
    name : str
        Its name in the table.
    value : float
        The number, in `unit`.
    unit : str
        SI unit, `MB` (1e6 bytes), or empty.
    at_most, at_least : float or None
        The aim; None if there is none.
    """

    key: str
    name: str
    value: float
    unit: str
    at_most: float | None = None
    at_least: float | None = None

    @property
    def met(self) -> bool | None:
        """True if the aim is met; None without an aim."""
        if self.at_most is None and self.at_least is None:
            return None
        below = self.at_most is None or self.value <= self.at_most
        return below and (self.at_least is None or self.value >= self.at_least)


@dataclass(frozen=True, slots=True)
class PipelineBench:
    """All figures of one run, and what must be known to read them."""

    figures: tuple[Figure, ...]
    notes: tuple[str, ...]

    def value(self, key: str) -> float:
        """One figure's number; KeyError for an unknown key."""
        return {figure.key: figure.value for figure in self.figures}[key]

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values."""
        return {
            "schema": "pipeline_bench/1",
            "figures": [asdict(figure) | {"met": figure.met} for figure in self.figures],
            "notes": list(self.notes),
        }

    def as_text(self) -> str:
        """An aligned table, then the notes."""
        rows = [_HEADINGS, *(_row(figure) for figure in self.figures)]
        widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADINGS))]
        return "\n".join([*(_line(row, widths) for row in rows), "", *self.notes])


def _row(figure: Figure) -> tuple[str, ...]:
    limits = (("<=", figure.at_most), (">=", figure.at_least))
    aim = ", ".join(f"{sign} {number_text(limit)}" for sign, limit in limits if limit is not None)
    met = {None: "", True: "yes", False: "NO"}[figure.met]
    return figure.name, number_text(figure.value), figure.unit, aim, met


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    name, value, *rest = row
    cells = [name.ljust(widths[0]), value.rjust(widths[1])]
    cells += [cell.ljust(width) for cell, width in zip(rest, widths[2:], strict=True)]
    return "  ".join(cells).rstrip()


def number_text(value: float) -> str:
    """Three significant digits, all digits of what is greater, thousands parted by commas."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
