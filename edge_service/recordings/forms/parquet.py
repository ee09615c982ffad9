"""Rows of a Parquet file, block by block."""

from pathlib import Path
from typing import Any

from ...messages.samples import Floats
from ..block import Block, Text, floats_from_text, number_rows
from ..columns import TraceError
from .form import Form

MAGIC = b"PAR1"
PARQUET_SUFFIXES = (".parquet", ".pq")
BLOCK_ROWS = 1 << 14
_BUFFER_BYTES = 1 << 18


class ParquetSource:
    """An open Parquet file. Nulls and cells that are no numbers become NaN."""

    remarks: tuple[str, ...] = ()

    def __init__(self, path: Path) -> None:
        import pyarrow as pa
        import pyarrow.parquet

        self.path = path
        self.ragged_rows = 0
        self._rows_seen = 0
        self._wanted: list[str] = []
        self._batches: Any = None
        self._handle = path.open("rb")
        try:
            # Without pre-buffering a file of one huge row group is not read at once.
            self._file = pyarrow.parquet.ParquetFile(
                self._handle,
                buffer_size=_BUFFER_BYTES,
                pre_buffer=False,
                page_checksum_verification=True,
            )
            self._schema = self._file.schema_arrow
        except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
            self._handle.close()
            raise self._broken(error) from None
        self.names = tuple(self._schema.names)

    @property
    def fraction_read(self) -> float:
        """Fraction of the file that has been read, 0 to 1."""
        return self._rows_seen / max(int(self._file.metadata.num_rows), 1)

    def holds_numbers(self, name: str) -> bool:
        """Tell whether a column is of a type that may hold numbers."""
        cell_type = self._schema.field(name).type
        return _holds_numbers(cell_type) or _holds_text(cell_type)

    def want(self, names: list[str]) -> None:
        """Read these columns only. Raises TraceError for one that cannot hold numbers."""
        for name in names:
            if not self.holds_numbers(name):
                cell_type = self._schema.field(name).type
                raise TraceError(
                    f"{self.path}: column {name!r} is of type {cell_type}; expected numbers"
                )
        self._wanted = names
        self._batches = self._file.iter_batches(BLOCK_ROWS, columns=names, use_threads=False)

    def close(self) -> None:
        """Close the file; safe twice."""
        self._batches = None
        self._handle.close()

    def read_block(self) -> Block | None:
        """The next rows, or None at the end. Raises TraceError."""
        import pyarrow as pa

        try:
            batch = next(self._batches, None)
            return None if batch is None else self._block(batch)
        except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
            raise self._broken(error) from None

    def _block(self, batch: Any) -> Block:
        values: dict[str, Floats] = {}
        text: dict[str, Text] = {}
        for name in self._wanted:
            values[name], wrong = _floats(batch.column(name))
            if wrong is not None:
                text[name] = wrong
        number = number_rows(self._rows_seen, batch.num_rows)
        self._rows_seen += batch.num_rows
        return Block(values, number, text)

    def _broken(self, error: Exception) -> TraceError:
        reason = " ".join(str(error).split())[:120]
        if isinstance(error, MemoryError):
            return TraceError(f"{self.path}: its content needs too much memory ({reason})")
        return TraceError(f"{self.path}: a truncated or damaged Parquet file ({reason})")


def _holds_numbers(cell_type: Any) -> bool:
    from pyarrow import types

    return bool(
        types.is_floating(cell_type)
        or types.is_integer(cell_type)
        or types.is_decimal(cell_type)
        or types.is_boolean(cell_type)
        or types.is_null(cell_type)
    )


def _holds_text(cell_type: Any) -> bool:
    from pyarrow import types

    if types.is_dictionary(cell_type):
        cell_type = cell_type.value_type
    return bool(types.is_string(cell_type) or types.is_large_string(cell_type))


def _floats(column: Any) -> tuple[Floats, Text | None]:
    import pyarrow as pa
    from pyarrow import types

    if types.is_dictionary(column.type):
        column = column.dictionary_decode()
    if _holds_text(column.type):
        return floats_from_text(column)
    return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), None


def _recognises(head: bytes, path: Path) -> bool:
    magic = head[: len(MAGIC)]
    return magic == MAGIC or (not magic.strip() and path.suffix.lower() in PARQUET_SUFFIXES)


FORM = Form("Parquet", _recognises, lambda path, _axis: ParquetSource(path))
