"""Tables of the benchmarks: aligned text for people, JSON-able rows for programs."""

import math
from collections.abc import Container, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

MISSING = "-"
_HEADINGS = ("figure", "value", "unit", "aim", "met")


def aligned(rows: Sequence[Sequence[str]], right: Container[int] = ()) -> list[str]:
    """Lines of a table whose columns are as wide as their widest cell.

    Args:
        right: numbers of the columns that are flush right.

    >>> aligned([("a", "value"), ("long", "1")], right=(1,))
    ['a     value', 'long      1']
    """
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return [
        "  ".join(
            cell.rjust(width) if k in right else cell.ljust(width)
            for k, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]


def markdown(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table in Markdown."""
    body = [f"| {' | '.join(row)} |" for row in rows]
    return [f"| {' | '.join(heads)} |", f"|{'---|' * len(heads)}", *body]


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the estimator's benchmark.

    Attributes:
        name: of the part, and of its rows in JSON.
        heads: of the figures, in the order of the table.
        rows: a label and the figures (as many as heads) of each row.
        notes: what must be known to read them.
    """

    name: str
    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, tuple[object, ...]], ...]
    notes: tuple[str, ...] = ()

    def as_text(self) -> str:
        """An aligned table, then the notes."""
        table = [(self.title, *self.heads)]
        table += [(label, *(cell(figure) for figure in row)) for label, row in self.rows]
        return "\n".join([*aligned(table, right=range(1, len(table[0]))), *self.notes])

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values; what is not a number is null, what never came is "never"."""
        rows = [
            {"row": label}
            | {key_of(head): plain(x) for head, x in zip(self.heads, row, strict=True)}
            for label, row in self.rows
        ]
        return {"rows": rows, "notes": list(self.notes)}


def key_of(head: str) -> str:
    """A head as a key for a program: small letters without blanks."""
    return head.lower().replace(" ", "_")


def cell(figure: object) -> str:
    """One figure as printed: three digits after the point, whole numbers as they are."""
    if figure is None:
        return MISSING
    if isinstance(figure, list | tuple):
        return " ".join(cell(each) for each in figure) or MISSING
    if not isinstance(figure, float):
        return str(figure)
    if math.isnan(figure):
        return MISSING
    return "never" if math.isinf(figure) else f"{figure:.3f}"


def plain(figure: object) -> object:
    """A figure for JSON, or figures within lists and dictionaries."""
    if isinstance(figure, dict):
        return {name: plain(each) for name, each in figure.items()}
    if isinstance(figure, list | tuple):
        return [plain(each) for each in figure]
    if isinstance(figure, float) and not math.isfinite(figure):
        return None if math.isnan(figure) else "never"
    return figure


def mean_of(values: Sequence[float]) -> float:
    """Mean of those that are finite; NaN without any."""
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else math.nan


class Figures(Protocol):
    """Figures of one run."""

    def as_text(self) -> str:
        """Aligned tables, for a terminal."""

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values."""


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
            "schema": "drivers-bench/1",
            "figures": [asdict(figure) | {"met": figure.met} for figure in self.figures],
            "notes": list(self.notes),
        }

    def as_text(self) -> str:
        """An aligned table, then the notes."""
        rows = [_HEADINGS, *(_row(figure) for figure in self.figures)]
        return "\n".join([*aligned(rows, right=(1,)), "", *self.notes])


def _row(figure: Figure) -> tuple[str, ...]:
    limits = (("<=", figure.at_most), (">=", figure.at_least))
    aim = ", ".join(f"{sign} {number_text(limit)}" for sign, limit in limits if limit is not None)
    met = {None: "", True: "yes", False: "NO"}[figure.met]
    return figure.name, number_text(figure.value), figure.unit, aim, met


def number_text(value: float) -> str:
    """Three significant digits, all digits of what is greater, thousands parted by commas."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
