"""Sections of the estimator's bench: a table of figures for people, rows for a program."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from .estimator.scores import Track

MISSING = "-"


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """A picture to be drawn: truth, estimate and interval over time."""

    title: str
    track: Track


@dataclass(frozen=True, slots=True)
class Section:
    """One part of the bench.

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
        widths = [max(len(line[k]) for line in table) for k in range(len(table[0]))]
        return "\n".join([*(_line(line, widths) for line in table), *self.notes])

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
    """One figure for JSON."""
    if isinstance(figure, list | tuple):
        return [plain(each) for each in figure]
    if isinstance(figure, float) and not math.isfinite(figure):
        return None if math.isnan(figure) else "never"
    return figure


def mean_of(values: Sequence[float]) -> float:
    """Mean of those that are finite; NaN without any."""
    finite = [value for value in values if math.isfinite(value)]
    return sum(finite) / len(finite) if finite else math.nan


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = cells
    padded = (text.rjust(width) for text, width in zip(others, widths[1:], strict=True))
    return "  ".join([first.ljust(widths[0]), *padded]).rstrip()
