"""Edge blocks: columns of numbers, readable with a standard library alone.

    bytes 0..3    b"EDB1"
    bytes 4..7    length H of the header, unsigned 32 bit, little endian
    bytes 8..8+H  header, UTF-8 JSON: {"schema", "axis", "sequence", "boot_epoch",
                  "source_time_ns", "monotonic_time_ns", "rows", "columns": [[name, unit], ...]}
    then          per column `rows` little-endian float64 values, column after column

Integers and flags travel as float64 too (all are far below 2**53). Samples that are not all good
bring a column `CHANNEL.quality` of `Quality` codes; columns of fast sensors among the features have
a dot in their names.
"""

import json
import struct
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, ClassVar, Generic

import numpy as np

from .codec import (
    FURTHEST,
    CodecError,
    Header,
    T,
    checked_axis,
    header_members,
    header_schema,
    parse_bounded,
    take_header,
)
from .features import (
    FEATURE_FIELDS,
    PHASE_FIELDS,
    PHASES,
    Fault,
    FeatureBlock,
    Phase,
    VibrationColumn,
)
from .keys import check_column
from .row_faults import WILDEST
from .samples import CHANNELS, TIME, Floats, Qualities, SampleFrame, Waveform

BLOCK_ENCODING = "application/octet-stream;edge-block/1"
MAGIC = b"EDB1"
MOST_COLUMNS, MOST_UNIT = 256, 32
LONGEST_S = 1e11
"""No clock of an axis shows more, s: some three thousand years."""
PERIOD_S = (1e-7, 10.0)
"""Shortest and longest time between two values of a fast sensor, s."""
_PREFIX = struct.Struct("<4sI")
_QUALITY = ".quality"
_EVERY_FAULT, _MOST_COUNT = int(~Fault.NONE), 2**31
_INTEGER_FEATURES = frozenset({"sample_count", "reversal_count"})
_PHASE_COLUMNS = {(phase, field): f"{phase}_{field}" for phase in PHASES for field in PHASE_FIELDS}
_FEATURE_UNITS = {"s": "s", "nm": "N m", "rad": "rad", "m": "m", "c": "degC", "n": "N"}


@dataclass(frozen=True)
class BlockCodec(ABC, Generic[T]):
    """Codec of one type of block; a subclass says what its columns are."""

    schema: str
    units: ClassVar[Mapping[str, str]] = {TIME: "s"}
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
        columns, units = self.to_columns(payload)
        members: dict[str, Any] = {"schema": self.schema, "axis": axis}
        members |= header_members(header)
        members["rows"] = len(next(iter(columns.values())))
        members["columns"] = [(name, units.get(name, "")) for name in columns]
        text = json.dumps(members).encode()
        body = np.concatenate(list(columns.values())).astype("<f8", copy=False)
        return b"".join([_PREFIX.pack(MAGIC, len(text)), text, body.tobytes()])

    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        """Axis, header and payload. Raises CodecError."""
        try:
            magic, length = _PREFIX.unpack_from(payload)
            if magic != MAGIC:
                raise CodecError("no edge block: wrong first four bytes")
            start = _PREFIX.size + length
            members = parse_bounded(payload[_PREFIX.size : start])
            body = np.frombuffer(payload, dtype="<f8", offset=start)
        except CodecError:
            raise
        except (ValueError, RecursionError, struct.error) as error:
            raise CodecError(f"no edge block: {error}") from error
        if members.get("schema") != self.schema:
            found = f"{members.get('schema')!r:.40}"
            raise CodecError(f"{found} block where {self.schema} was expected")
        units, rows = _units(members.get("columns")), members.get("rows")
        if type(rows) is not int or rows < 0 or body.size != rows * len(units):
            raise CodecError("an edge block whose size contradicts its header")
        table = body.reshape(len(units), rows).astype(np.float64)
        table.flags.writeable = False
        columns = dict(zip(units, table, strict=True))
        return checked_axis(members), take_header(members), self.from_columns(columns, units)

    def description(self) -> dict[str, Any]:
        """Header and columns of a block."""
        return {
            "title": self.schema,
            "encoding": MAGIC.decode(),
            "header": {"schema": {"const": self.schema}} | header_schema(),
            "columns": dict(self.units),
        }


def _units(columns: object) -> dict[str, str]:
    """Units by the names of the columns. Raises CodecError."""
    units: dict[str, str] = {}
    for column in columns if isinstance(columns, list) else ():
        match column:
            case [str(name), str(unit)] if name not in units and len(unit) <= MOST_UNIT:
                try:
                    units[check_column(name)] = unit
                except ValueError as error:
                    raise CodecError(f"an edge block with a column: {error}") from None
            case _:
                raise CodecError("a column that is no name with its unit")
    if not 0 < len(units) <= MOST_COLUMNS:
        raise CodecError("an edge block without columns, or with too many")
    return units


class SampleCodec(BlockCodec[SampleFrame]):
    """Samples: columns `time_s` and the frame's channels."""

    def to_columns(self, payload: SampleFrame) -> tuple[dict[str, Floats], dict[str, str]]:
        """Columns and units of a frame."""
        columns = {TIME: payload.time_s, **payload.channels}
        for name, codes in payload.quality.items():
            if codes.any():
                columns[name + _QUALITY] = codes.astype(np.float64)
        units = {name: CHANNELS[name].unit for name in columns if name in CHANNELS}
        return columns, units | {TIME: "s"}

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> SampleFrame:
        """Frame of columns. Raises CodecError."""
        if TIME not in columns:
            raise CodecError("a block of samples without time_s")
        time_s = columns.pop(TIME)
        if not time_s.size or not _is_within(time_s, LONGEST_S):
            raise CodecError("a block of samples without rows, or at an impossible time")
        quality = {
            name.removesuffix(_QUALITY): _codes(columns.pop(name))
            for name in [name for name in columns if name.endswith(_QUALITY)]
        }
        try:
            return SampleFrame(time_s, columns, quality)
        except ValueError as error:
            raise CodecError(f"a block of samples: {error}") from None


def _is_within(values: Floats, most: float) -> bool:
    """All values are finite and within [-most, most]."""
    return bool((np.abs(values) <= most).all())


def _codes(column: Floats) -> Qualities:
    if not ((column >= 0.0) & (column <= 255.0)).all():
        raise CodecError("a quality that is no code")
    return column.astype(np.uint8)


class WaveformCodec(BlockCodec[Waveform]):
    """A piece of a fast sensor's signal: columns `time_s` and the sensor."""

    def to_columns(self, payload: Waveform) -> tuple[dict[str, Floats], dict[str, str]]:
        """Columns and units of a signal."""
        columns = {TIME: payload.time_s, payload.sensor: payload.values}
        return columns, {TIME: "s", payload.sensor: payload.unit}

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> Waveform:
        """Signal of columns. Raises CodecError."""
        time_s = columns.pop(TIME, None)
        if time_s is None or len(columns) != 1 or len(time_s) < 2:
            raise CodecError("a waveform without a clock and one sensor")
        if not _is_within(time_s, LONGEST_S):
            raise CodecError("a waveform at an impossible time")
        ((sensor, values),) = columns.items()
        period_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
        if not PERIOD_S[0] <= period_s <= PERIOD_S[1]:
            raise CodecError("a waveform with an impossible period")
        if not _is_within(np.nan_to_num(values, posinf=np.inf, neginf=-np.inf), WILDEST):
            raise CodecError("a waveform with values that no sensor has")
        return Waveform(sensor, units[sensor], float(time_s[0]), period_s, values)


def _feature_unit(name: str) -> str:
    for end, unit in (("rad_s2", "rad/s^2"), ("rad_s", "rad/s")):
        if name.endswith(end):
            return unit
    return _FEATURE_UNITS.get(name.rpartition("_")[2], "")


class FeatureCodec(BlockCodec[FeatureBlock]):
    """One interval as one row: the fields of FeatureBlock, of its phases and of fast sensors.

    Columns that this version does not know are left unread.
    """

    units = {name: _feature_unit(name) for name in (*FEATURE_FIELDS, *_PHASE_COLUMNS.values())}

    def to_columns(self, payload: FeatureBlock) -> tuple[dict[str, Floats], Mapping[str, str]]:
        """Columns and units of an interval."""
        names = [*self.units, *(each.name for each in payload.vibration)]
        numbers = [*_numbers(payload), *(each.value for each in payload.vibration)]
        row = np.array(numbers, dtype=np.float64).reshape(-1, 1)
        fast = {each.name: each.unit for each in payload.vibration}
        return dict(zip(names, row, strict=True)), {**self.units, **fast}

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> FeatureBlock:
        """Interval of columns. Raises CodecError."""
        fast = {name: column for name, column in columns.items() if "." in name}
        if self.units.keys() - columns.keys():
            raise CodecError("a block of features without columns that every block has")
        columns = {name: columns[name] for name in self.units}
        if len(columns[TIME]) != 1:
            raise CodecError("a block of features with another number of rows than one")
        vibration = tuple(VibrationColumn(k, float(v[0]), units[k]) for k, v in fast.items())
        row: list[float] = np.concatenate(list(columns.values())).tolist()
        if any(abs(number) > FURTHEST for number in (*row, *(each.value for each in vibration))):
            raise CodecError("an interval with numbers that nobody can measure")
        values = dict(zip(columns, row, strict=True))
        if not (0.0 < values["duration_s"] <= LONGEST_S and abs(values[TIME]) <= LONGEST_S):
            raise CodecError("an interval at an impossible time")
        integers = {name: _whole(values.pop(name), _MOST_COUNT) for name in _INTEGER_FEATURES}
        fault = Fault(_whole(values.pop("fault"), _EVERY_FAULT))
        phases = {
            phase: Phase(
                **{field: values.pop(_PHASE_COLUMNS[phase, field]) for field in PHASE_FIELDS}
            )
            for phase in PHASES
        }
        fields: dict[str, Any] = integers | values | phases
        return FeatureBlock(fault=fault, vibration=vibration, **fields)


def _whole(value: float, most: int) -> int:
    if not (0.0 <= value <= most and value.is_integer()):
        raise CodecError("a count that is none")
    return int(value)


_numbers = attrgetter(*FEATURE_FIELDS, *(f"{phase}.{field}" for phase, field in _PHASE_COLUMNS))
"""All numbers of an interval, in the order of the columns."""
