"""A run of rows as a file gives them, before channels and units."""

import contextlib
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..messages.samples import Floats

_NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*$"
_MISSING = r"^\s*([+-]?nan(\(.*\))?|null|none|#?n/?a|[+-]?1\.#.*|[+-]?inf(inity)?)?\s*$"


@dataclass(frozen=True, slots=True)
class Text:
    """Cells of one column that should be numbers and are not."""

    count: int
    first: str


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """Rows of some columns.

    Attributes:
        values: column name -> values as they stand in the file, shape (n,); NaN where a cell
            holds no number.
        row_number: number of each row in the file, from 0, rows set aside included, shape (n,).
        text: what stands in place of numbers, for the columns where something does.
    """

    values: dict[str, Floats]
    row_number: Floats
    text: dict[str, Text] = field(default_factory=dict)

    def __len__(self) -> int:
        return int(self.row_number.shape[0])


class Source(Protocol):
    """An open file of one format.

    Attributes:
        names: the columns that the file has.
    """

    names: tuple[str, ...]

    @property
    def ragged_rows(self) -> int:
        """Rows with too few or too many cells, set aside so far."""

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks that a reader of the rows should know, one line each."""

    def holds_numbers(self, name: str) -> bool:
        """Tell whether a column may hold numbers."""

    def want(self, names: list[str]) -> None:
        """Read these columns only. Raises TraceError for one that cannot hold numbers."""

    def read_block(self) -> Block | None:
        """The next rows, or None at the end."""

    def close(self) -> None:
        """Close the file; safe twice."""


def number_rows(first: int, count: int) -> Floats:
    """Row numbers first, first + 1, ..., shape (count,)."""
    return np.arange(first, first + count, dtype=np.float64)


def floats_from_text(cells: Any, decimal_point: str = ".") -> tuple[Floats, Text | None]:
    """Numbers in an Arrow array of byte strings; NaN and an account of it where there is none.

    Returns:
        Values of shape (n,), and the cells that are neither a number nor a word for a missing
        one, or None if there are no such cells.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    raw = pc.cast(cells, pa.large_binary())
    if decimal_point != ".":
        raw = pc.replace_substring(raw, decimal_point, ".")
    with contextlib.suppress(pa.ArrowInvalid):
        return _floats(raw), None
    is_number = pc.fill_null(pc.match_substring_regex(raw, _NUMBER), False)
    is_missing = pc.fill_null(pc.match_substring_regex(raw, _MISSING, ignore_case=True), True)
    numbers = pc.if_else(is_number, raw, pa.scalar(None, pa.large_binary()))
    wrong = cells.filter(pc.invert(pc.or_(is_number, is_missing)))
    if len(wrong) == 0:
        return _floats(numbers), None
    first = pc.cast(wrong.slice(0, 1), pa.binary())[0].as_py().decode("utf-8", "replace")
    return _floats(numbers), Text(len(wrong), first[:40])


def _floats(raw: Any) -> Floats:
    import pyarrow as pa
    import pyarrow.compute as pc

    text = pc.utf8_trim_whitespace(pc.cast(raw, pa.large_string()))
    values: Floats = pc.cast(text, pa.float64()).to_numpy(zero_copy_only=False)
    return values
