"""An open file of one form, and the rows that it gives, before channels and units."""

import contextlib
import io
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..messages.samples import Floats

MOST_COLUMNS = 4096
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
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


class Source:
    """An open file of one form; forms override `read_block` and what is not as usual.

    Attributes:
        path: the file.
        names: the columns that it has.
        ragged_rows: rows with too few or too many cells, set aside so far.
        wanted: the columns that are read.
    """

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self.path = path
        self.names: tuple[str, ...] = ()
        self.ragged_rows = 0
        self.wanted: list[str] = []
        self._file = file
        self._bytes = max(file.seek(0, io.SEEK_END), 1)
        self._rows_seen = 0
        file.seek(0)

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return 1.0 if self._file.closed else self._file.tell() / self._bytes

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks that a reader of the rows should know, one line each."""
        return ()

    def holds_numbers(self, name: str) -> bool:
        """Return whether a column may hold numbers."""
        return name in self.names

    def want(self, names: list[str]) -> None:
        """Read these columns only. Raises TraceError for one that cannot hold numbers."""
        self.wanted = names

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        raise NotImplementedError

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def _number_rows(self, count: int) -> Floats:
        """Numbers of the next rows of the file, shape (count,)."""
        first, self._rows_seen = self._rows_seen, self._rows_seen + count
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

    def floats(raw: Any) -> Floats:
        text = pc.utf8_trim_whitespace(pc.cast(raw, pa.large_string()))
        values: Floats = pc.cast(text, pa.float64()).to_numpy(zero_copy_only=False)
        return values

    with contextlib.suppress(pa.ArrowInvalid):
        return floats(raw), None
    is_number = pc.fill_null(pc.match_substring_regex(raw, _NUMBER), False)
    is_missing = pc.fill_null(pc.match_substring_regex(raw, _MISSING, ignore_case=True), True)
    numbers = pc.if_else(is_number, raw, pa.scalar(None, pa.large_binary()))
    wrong = cells.filter(pc.invert(pc.or_(is_number, is_missing)))
    if len(wrong) == 0:
        return floats(numbers), None
    first = pc.cast(wrong.slice(0, 1), pa.binary())[0].as_py().decode("utf-8", "replace")
    return floats(numbers), Text(len(wrong), first[:40])
