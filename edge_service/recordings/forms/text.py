"""Rows of a CSV file, block by block."""

import re
from pathlib import Path
from typing import Any

import numpy as np

from ...messages.samples import Floats
from ..block import Block, Text, floats_from_text, number_rows
from ..columns import TraceError
from .foreign import foreign
from .form import Form
from .text_layout import SPACES, read_layout

BLOCK_BYTES = 1 << 19
LONGEST_LINE = 1 << 22
_ASCII = bytes(range(128)) + b"?" * 128
_SPACES, _AT_ENDS = re.compile(rb"[ \t]+"), re.compile(rb"^ | (?=\r?$)", re.MULTILINE)
_QUOTED = re.compile(rb'"([^"\r\n]*)"')


class CsvSource:
    """An open CSV file. Cells that are no numbers become NaN, ragged rows are counted."""

    remarks: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        self.path = path
        self.ragged_rows = 0
        self._rows_seen = 0
        self._bytes = path.stat().st_size
        self._rest = b""
        self._wanted: list[int] = []
        self._file = path.open("rb")
        try:
            self._layout = read_layout(path, self._file.read(BLOCK_BYTES))
            self._file.seek(self._layout.start)
        except BaseException:
            self._file.close()
            raise
        self.names = self._layout.names

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return 1.0 if self._file.closed else self._file.tell() / max(self._bytes, 1)

    def holds_numbers(self, name: str) -> bool:
        """Any column may."""
        return name in self.names

    def want(self, names: list[str]) -> None:
        """Read these columns only."""
        self._wanted = [self.names.index(name) for name in names]

    def close(self) -> None:
        """Close the file; safe twice."""
        self._file.close()

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError and OSError."""
        raw = self._read_lines()
        if raw is None:
            return None
        raw = self._plain(raw)
        table, ragged = self._parse(raw)
        rows = table.num_rows + len(ragged)
        number = number_rows(self._rows_seen, rows)
        if ragged:
            number = np.delete(number, [min(row, rows) - 1 for row in ragged])
        self._rows_seen += rows
        self.ragged_rows += len(ragged)
        return self._block(table, number)

    def _read_lines(self) -> bytes | None:
        """Whole lines of about one block; at the end of the file whatever is left, then None."""
        while data := self._file.read(BLOCK_BYTES):
            lines, found, rest = data.rpartition(self._layout.terminator)
            if found:
                lines = self._rest + lines + found
                self._rest = rest
                return lines
            self._rest += data
            if len(self._rest) > LONGEST_LINE:
                raise TraceError(f"{self.path}: a line of more than {LONGEST_LINE} bytes")
        rest, self._rest = self._rest, b""
        return rest or None

    def _plain(self, raw: bytes) -> bytes:
        """The same cells in ASCII without quotes, which a broken row could spread over others."""
        if not raw.isascii():
            raw = raw.translate(_ASCII)
        if b'"' in raw:
            delimiter = self._layout.delimiter.encode()
            raw = _QUOTED.sub(lambda match: match[1].replace(delimiter, b" "), raw)
        if self._layout.delimiter == SPACES:
            raw = _AT_ENDS.sub(b"", _SPACES.sub(b" ", raw))
        return raw

    def _parse(self, raw: bytes) -> tuple[Any, list[int]]:
        """Arrow table of the wanted columns, and the row numbers (from 1) of the ragged rows."""
        import pyarrow as pa

        try:
            return self._read_csv(raw, pa.float64())
        except pa.ArrowInvalid:
            return self._read_csv(raw, pa.large_binary())

    def _read_csv(self, raw: bytes, cell_type: Any) -> tuple[Any, list[int]]:
        import pyarrow as pa
        import pyarrow.csv

        ragged: list[int] = []

        def skip(row: Any) -> str:
            ragged.append(row.number)
            return "skip"

        keys = [str(index) for index in range(len(self.names))]
        wanted = [keys[index] for index in self._wanted]
        table = pyarrow.csv.read_csv(
            pa.BufferReader(raw),
            # Without threads the parser knows the number of a ragged row; block_size is one block.
            read_options=pyarrow.csv.ReadOptions(
                column_names=keys, block_size=len(raw) + 1, use_threads=False
            ),
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=self._layout.delimiter, quote_char=False, invalid_row_handler=skip
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict.fromkeys(wanted, cell_type),
                include_columns=wanted,
                decimal_point=self._layout.decimal_point,
                strings_can_be_null=True,
            ),
        )
        return table, ragged

    def _block(self, table: Any, number: Floats) -> Block:
        import pyarrow as pa

        values: dict[str, Floats] = {}
        text: dict[str, Text] = {}
        for index, column in zip(self._wanted, table.columns, strict=True):
            name = self.names[index]
            if column.type == pa.float64():
                values[name] = column.to_numpy()
                continue
            values[name], wrong = floats_from_text(column, self._layout.decimal_point)
            if wrong is not None:
                text[name] = wrong
        return Block(values, number, text)


FORM = Form(
    "text (CSV)",
    lambda head, _path: foreign(head) is None,
    lambda path, _axis: CsvSource(path),
    rank=1,
)
