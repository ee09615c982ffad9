"""Edge blocks: columns of numbers, readable with a standard library alone.

    bytes 0..3    b"EDB1"
    bytes 4..7    length H of the header, unsigned 32 bit, little endian
    bytes 8..8+H  header, UTF-8 JSON: {"schema", "axis", "sequence", "boot_epoch",
                  "source_time_ns", "monotonic_time_ns", "rows", "columns": [[name, unit], ...]}
    then          per column `rows` little-endian float64 values, column after column

Integers and flags travel as float64 too (all are far below 2**53).
"""

import json
import struct
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any, ClassVar, Generic

import numpy as np

from ..header import Header
from ..names import check_column
from ..samples import Floats
from .bounded_json import parse_bounded
from .interface import CodecError, T, checked_axis, header_members, header_schema, take_header

BLOCK_ENCODING = "application/octet-stream;edge-block/1"
MAGIC = b"EDB1"
MOST_COLUMNS, MOST_UNIT = 256, 32
_PREFIX = struct.Struct("<4sI")
_COLUMNS = b', "columns": '
"""Parts the members that change from block to block from those that stay."""
_LONGEST_COLUMNS = 16_384


@dataclass(frozen=True)
class BlockCodec(ABC, Generic[T]):
    """Codec of one type of block; a subclass says what its columns are."""

    schema: str
    units: ClassVar[Mapping[str, str]] = {"time_s": "s"}
    """Units of the columns that every block of the type has."""

    @property
    def encoding(self) -> str:
        """The Zenoh encoding."""
        return BLOCK_ENCODING

    @abstractmethod
    def to_columns(self, payload: T) -> tuple[Mapping[str, Floats], Mapping[str, str]]:
        """Columns (n,) of a payload by name, and the units of those that have one."""

    @abstractmethod
    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> T:
        """Payload of columns. Raises CodecError."""

    def encode(self, axis: str | None, header: Header, payload: T) -> bytes:
        """Bytes of a payload with its axis and header."""
        rows, columns, body = self.table(payload)
        members = {"schema": self.schema, "axis": axis} | header_members(header)
        members["rows"] = rows
        text = json.dumps(members).encode()[:-1] + _described(columns)
        return b"".join([_PREFIX.pack(MAGIC, len(text)), text, *body])

    def holds(self, payload: T) -> bool:
        """False: what comes from machines is read as it was sent."""
        return False

    def table(self, payload: T) -> tuple[int, tuple[tuple[str, str], ...], list[bytes]]:
        """Rows, name and unit of each column, and the bytes of the columns."""
        columns, units = self.to_columns(payload)
        body = [np.ascontiguousarray(column, dtype="<f8").tobytes() for column in columns.values()]
        described = tuple((name, units.get(name, "")) for name in columns)
        return len(next(iter(columns.values()))), described, body

    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        """Axis, header and payload. Raises CodecError."""
        members, units, body = self._parsed(payload)
        columns = _columns(members.get("rows"), list(units), body)
        return checked_axis(members), take_header(members), self.from_columns(columns, units)

    def description(self) -> dict[str, Any]:
        """Header and columns of a block."""
        return {
            "title": self.schema,
            "encoding": MAGIC.decode(),
            "header": {"schema": {"const": self.schema}} | header_schema(),
            "columns": dict(self.units),
        }

    def _parsed(self, payload: bytes) -> tuple[dict[str, Any], Mapping[str, str], Floats]:
        """Header, units by column and numbers of a block of this schema. Raises CodecError."""
        try:
            magic, length = _PREFIX.unpack_from(payload)
            if magic != MAGIC:
                raise CodecError("no edge block: wrong first four bytes")
            start = _PREFIX.size + length
            members, units = _members(payload[_PREFIX.size : start])
            if members.get("schema") != self.schema:
                raise CodecError(
                    f"{members.get('schema')!r:.40} block where {self.schema} was expected"
                )
            return members, units, np.frombuffer(payload, dtype="<f8", offset=start)
        except CodecError:
            raise
        except (ValueError, RecursionError, struct.error) as error:
            raise CodecError(f"no edge block: {error}") from error


@lru_cache(64)
def _described(columns: tuple[tuple[str, str], ...]) -> bytes:
    """The end of a header: names and units of its columns."""
    return _COLUMNS + json.dumps(columns).encode() + b"}"


def _members(text: bytes) -> tuple[dict[str, Any], Mapping[str, str]]:
    """Members of a header, and units by column. Raises CodecError, ValueError, RecursionError.

    Columns are the same from block to block: their text is parsed once.
    """
    changing, found, columns = text.partition(_COLUMNS)
    if found and len(columns) <= _LONGEST_COLUMNS:
        try:
            return parse_bounded(changing + b"}"), _units_of(columns)
        except ValueError:
            pass  # members in another order, or nested: all of it is parsed
    members = parse_bounded(text)
    return members, _units(members.get("columns"))


@lru_cache(64)
def _units_of(text: bytes) -> Mapping[str, str]:
    """Units by column, of the text of a header from its columns on. Raises ValueError."""
    members = parse_bounded(b'{"columns": ' + text)
    if len(members) > 1:
        raise ValueError("members beside the columns")
    return MappingProxyType(_units(members["columns"]))


def _units(columns: object) -> dict[str, str]:
    """Units by the names of the columns. Raises CodecError."""
    units: dict[str, str] = {}
    for column in columns if isinstance(columns, list) else ():
        match column:
            case [str(name), str(unit)] if name not in units and len(unit) <= MOST_UNIT:
                units[_checked(name)] = unit
            case _:
                raise CodecError("a column that is no name with its unit")
    if not 0 < len(units) <= MOST_COLUMNS:
        raise CodecError("an edge block without columns, or with too many")
    return units


def _checked(name: str) -> str:
    try:
        return check_column(name)
    except ValueError as error:
        raise CodecError(f"an edge block with a column: {error}") from None


def _columns(rows: object, names: list[str], body: Floats) -> dict[str, Floats]:
    """Columns (rows,) by name, for reading only. Raises CodecError."""
    if type(rows) is not int or rows < 0 or body.size != rows * len(names):
        raise CodecError("an edge block whose size contradicts its header")
    table = body.reshape(len(names), rows).astype(np.float64)
    table.flags.writeable = False
    return dict(zip(names, table, strict=True))
