"""Rows of a Parquet file, block by block."""

import io
from pathlib import Path
from typing import IO, Any

from ..messages.samples import Floats
from .columns import TraceError
from .source import MOST_COLUMNS, Block, Source, Text, floats_from_text

MAGIC = b"PAR1"
PARQUET_SUFFIXES = (".parquet", ".pq")
BLOCK_ROWS, TEXT_ROWS = 1 << 14, 1 << 5
LARGEST_PAGE_BYTES, LARGEST_TEXT_PAGE_BYTES = 1 << 26, 1 << 22
_BUFFER_BYTES, _LARGEST_HEADER_BYTES = 1 << 18, 1 << 12
_LIMITS: dict[str, Any] = {"thrift_string_size_limit": 2**24, "thrift_container_size_limit": 2**16}


def parquet_extent(path: Path, name: str) -> tuple[int, float | None, float | None]:
    """Rows of a file, least and greatest value of a column by its footer. Raises as Arrow does."""
    import pyarrow.parquet

    with pyarrow.parquet.ParquetFile(path, **_LIMITS) as file:
        footer = file.metadata
    groups = [footer.row_group(number) for number in range(footer.num_row_groups)]
    chunks = [group.column(number) for group in groups for number in range(group.num_columns)]
    found = [each.statistics for each in chunks if each.path_in_schema == name]
    known = [each for each in found if each is not None and each.has_min_max]
    if not known:
        return footer.num_rows, None, None
    return footer.num_rows, float(known[0].min), float(known[-1].max)


class ParquetSource(Source):
    """An open Parquet file. Nulls and cells that are no numbers become NaN."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        import pyarrow as pa
        import pyarrow.parquet

        super().__init__(path, file)
        self._batches: Any = None
        try:
            # Without pre-buffering a file of one huge row group is not read at once.
            self._parquet = pyarrow.parquet.ParquetFile(
                file,
                buffer_size=_BUFFER_BYTES,
                pre_buffer=False,
                page_checksum_verification=True,
                **_LIMITS,
            )
            self._schema = self._parquet.schema_arrow
        except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
            raise self._broken(error) from None
        self.names, self._length = tuple(self._schema.names), int(self._parquet.metadata.num_rows)
        if len(self.names) > MOST_COLUMNS:
            raise TraceError(f"{path}: more than {MOST_COLUMNS} columns")

    def holds_numbers(self, name: str) -> bool:
        from pyarrow import types

        cell_type = self._schema.field(name).type
        kinds = (types.is_floating, types.is_integer, types.is_decimal, types.is_boolean)
        return any(of(cell_type) for of in (*kinds, types.is_temporal, types.is_null, _holds_text))

    def want(self, names: list[str]) -> None:
        for name in names:
            if not self.holds_numbers(name):
                cell_type = self._schema.field(name).type
                raise TraceError(
                    f"{self.path}: column {name!r} is of type {cell_type}; expected numbers"
                )
        self.wanted = names
        text = any(_holds_text(self._schema.field(name).type) for name in names)
        self._check_pages(LARGEST_TEXT_PAGE_BYTES if text else LARGEST_PAGE_BYTES)
        rows = TEXT_ROWS if text else BLOCK_ROWS
        self._batches = self._parquet.iter_batches(rows, columns=names, use_threads=False)

    def read_block(self) -> Block | None:
        import pyarrow as pa

        try:
            batch = next(self._batches, None)
            if batch is None:
                return None
            block = Block({}, self._number_rows(batch.num_rows))
            for name in self.wanted:
                block.values[name], wrong = _floats(batch.column(name))
                if wrong is not None:
                    block.text[name] = wrong
        except (pa.ArrowException, OSError, ValueError, MemoryError) as error:
            raise self._broken(error) from None
        return block

    def _check_pages(self, largest_bytes: int) -> None:
        """Refuse a wanted column with a page that unpacks to more: Arrow takes it at its word."""
        metadata = self._parquet.metadata
        for group in range(metadata.num_row_groups):
            for column in range(metadata.num_columns):
                chunk = metadata.row_group(group).column(column)
                if chunk.path_in_schema.split(".")[0] not in self.wanted:
                    continue
                position = chunk.data_page_offset
                if chunk.has_dictionary_page and chunk.dictionary_page_offset:
                    position = min(position, chunk.dictionary_page_offset)
                end = position + chunk.total_compressed_size
                while 0 < position < min(end, self._bytes):
                    self._file.seek(position)
                    sizes = page_sizes(self._file.read(_LARGEST_HEADER_BYTES))
                    if sizes is None:
                        break  # Arrow says what is wrong with it
                    header_bytes, unpacked_bytes, packed_bytes = sizes
                    if unpacked_bytes > largest_bytes:
                        raise TraceError(
                            f"{self.path}: a page of {unpacked_bytes} bytes; "
                            f"more than {largest_bytes} are not unpacked"
                        )
                    position += header_bytes + packed_bytes

    def _broken(self, error: Exception) -> TraceError:
        reason = " ".join(str(error).split())[:120]
        if isinstance(error, MemoryError):
            return TraceError(f"{self.path}: its content needs too much memory ({reason})")
        return TraceError(f"{self.path}: a truncated or damaged Parquet file ({reason})")


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
    if types.is_temporal(column.type):  # seconds
        per_s = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
        width = pa.int32() if column.type.bit_width == 32 else pa.int64()
        values = column.cast(width).to_numpy(zero_copy_only=False)
        return values / per_s[getattr(column.type, "unit", "s")], None
    return column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), None


def page_sizes(head: bytes) -> tuple[int, int, int] | None:
    """Bytes of a page's header, of the page unpacked and packed; None for no header.

    The header is a struct of Thrift's compact protocol; fields 2 and 3 are the sizes.
    """
    stream, numbers, fields = io.BytesIO(head), [0], dict[int, int]()

    def varint() -> int:
        value = shift = 0
        while True:
            octet = stream.read(1)[0]
            value |= (octet & 0x7F) << shift
            shift += 7
            if not octet & 0x80:
                return value

    def zigzag() -> int:
        value = varint()
        return (value >> 1) ^ -(value & 1)

    try:
        while numbers:  # of the current field, in each struct that is open
            delta, kind = divmod(stream.read(1)[0], 0x10)
            if not (delta or kind):
                numbers.pop()
                continue
            numbers[-1] = numbers[-1] + delta if delta else zigzag()
            if kind in (4, 5, 6):
                value = zigzag()
                if len(numbers) == 1:
                    fields[numbers[0]] = value
            elif kind == 8:
                stream.seek(varint(), io.SEEK_CUR)
            elif kind == 12:
                numbers.append(0)
            elif kind not in (1, 2):  # a truth stands in the type; no lists, no doubles
                return None
    except (IndexError, OverflowError):
        return None
    unpacked, packed = fields.get(2, -1), fields.get(3, -1)
    return (stream.tell(), unpacked, packed) if min(unpacked, packed) >= 0 else None


def recognises(head: bytes, path: Path) -> bool:
    """Parquet by its magic bytes, or by its name where nothing stands in the file."""
    magic = head[: len(MAGIC)]
    return magic == MAGIC or (not magic.strip() and path.suffix.lower() in PARQUET_SUFFIXES)
