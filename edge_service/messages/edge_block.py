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
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from typing import Any, ClassVar

import numpy as np

from .codec import FURTHEST, CodecError, Header, T, Topic, check_bounded, parse_object
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
from .samples import CHANNELS, TIME, Floats, SampleFrame, Waveform

BLOCK_ENCODING = "application/octet-stream;edge-block/1"
MAGIC = b"EDB1"
MOST_COLUMNS, MOST_UNIT = 256, 32
LONGEST_S = 1e11  # no clock of an axis shows more, s: some three thousand years
PERIOD_S = (1e-7, 10.0)  # shortest and longest time between two values of a fast sensor, s
_PREFIX = struct.Struct("<4sI")
_QUALITY = ".quality"
_MOST_COUNT = {"fault": int(~Fault.NONE), "sample_count": 2**31, "reversal_count": 2**31}
_UNITS = {"rad_s2": "rad/s^2", "rad_s": "rad/s", "s": "s", "nm": "N m", "rad": "rad", "m": "m"}
_UNITS |= {"c": "degC", "n": "N"}
"""Ending of a feature's name -> its unit, the longest first."""


@dataclass(frozen=True)
class BlockTopic(Topic[T]):
    """Topic of one type of block; a subclass says what its columns are."""

    encoding = BLOCK_ENCODING
    units: ClassVar[Mapping[str, str]] = {TIME: "s"}
    """Units of the columns that every block of the type has."""

    @abstractmethod
    def to_columns(self, payload: T) -> tuple[dict[str, Floats], Mapping[str, str]]:
        """Columns (n,) of a payload by name, and the units of those that have one."""

    @abstractmethod
    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> T:
        """Payload of columns. Raises CodecError."""

    def encode(self, axis: str | None, header: Header, payload: T) -> bytes:
        columns, units = self.to_columns(payload)
        members = self.members(axis, header)
        members["rows"] = len(next(iter(columns.values())))
        members["columns"] = [(name, units.get(name, "")) for name in columns]
        text = json.dumps(members).encode()
        body = np.concatenate(list(columns.values())).astype("<f8", copy=False)
        return b"".join([_PREFIX.pack(MAGIC, len(text)), text, body.tobytes()])

    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        try:
            magic, length = _PREFIX.unpack_from(payload)
            if magic != MAGIC:
                raise ValueError("wrong first four bytes")
            start = _PREFIX.size + length
            members = parse_object(payload[_PREFIX.size : start])
            columns = members.pop("columns", None)
            check_bounded(members)
            body = np.frombuffer(payload, dtype="<f8", offset=start)
        except (ValueError, RecursionError, struct.error) as error:
            raise CodecError(f"no edge block: {error}") from error
        units, rows = _units_of(json.dumps(columns)), members.get("rows")
        if type(rows) is not int or rows < 0 or body.size != rows * len(units):
            raise CodecError("an edge block whose size contradicts its header")
        axis, header = self.taken(members)
        table = body.reshape(len(units), rows).astype(np.float64)
        table.flags.writeable = False
        value = self.from_columns(dict(zip(units, table, strict=True)), units)
        self.check(value)
        return axis, header, value

    def description(self) -> dict[str, Any]:
        return {
            "title": self.schema,
            "encoding": MAGIC.decode(),
            "header": self.described(),
            "columns": dict(self.units),
        }


@lru_cache(64)
def _units_of(text: str) -> dict[str, str]:
    """Units by the names of the columns, as JSON. Raises CodecError."""
    units: dict[str, str] = {}
    columns = json.loads(text)
    for column in columns if isinstance(columns, list) else ():
        match column:
            case [str(name), str(unit)] if name not in units and len(unit) <= MOST_UNIT:
                try:
                    check_bounded({name: unit})
                    units[check_column(name)] = unit
                except ValueError as error:
                    raise CodecError(f"an edge block with a column: {error}") from None
            case _:
                raise CodecError("a column that is no name with its unit")
    if not 0 < len(units) <= MOST_COLUMNS:
        raise CodecError("an edge block without columns, or with too many")
    return units


def _check_time(time_s: Floats) -> None:
    if not len(time_s) or not (np.abs(time_s) <= LONGEST_S).all():
        raise CodecError("a block without rows, or at an impossible time")


class SampleTopic(BlockTopic[SampleFrame]):
    """Samples: columns `time_s` and the frame's channels."""

    def to_columns(self, payload: SampleFrame) -> tuple[dict[str, Floats], dict[str, str]]:
        columns = {TIME: payload.time_s, **payload.channels}
        for name, codes in payload.quality.items():
            if codes.any():
                columns[name + _QUALITY] = codes.astype(np.float64)
        units = {name: CHANNELS[name].unit for name in columns if name in CHANNELS}
        return columns, units | {TIME: "s"}

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> SampleFrame:
        time_s, quality = columns.pop(TIME, np.empty(0)), {}
        for name in [name for name in columns if name.endswith(_QUALITY)]:
            codes = columns.pop(name)
            if not ((codes >= 0.0) & (codes <= 255.0)).all():
                raise CodecError("a quality that is no code")
            quality[name.removesuffix(_QUALITY)] = codes.astype(np.uint8)
        try:
            return SampleFrame(time_s, columns, quality)
        except ValueError as error:
            raise CodecError(f"a block of samples: {error}") from None

    def check(self, payload: SampleFrame) -> None:
        _check_time(payload.time_s)


class WaveformTopic(BlockTopic[Waveform]):
    """A piece of a fast sensor's signal: columns `time_s` and the sensor."""

    def to_columns(self, payload: Waveform) -> tuple[dict[str, Floats], dict[str, str]]:
        columns = {TIME: payload.time_s, payload.sensor: payload.values}
        return columns, {TIME: "s", payload.sensor: payload.unit}

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> Waveform:
        time_s = columns.pop(TIME, np.empty(0))
        _check_time(time_s)
        if len(columns) != 1 or len(time_s) < 2:
            raise CodecError("a waveform without one sensor, or without two rows")
        ((sensor, values),) = columns.items()
        period_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
        return Waveform(sensor, units[sensor], float(time_s[0]), period_s, values)

    def check(self, payload: Waveform) -> None:
        _check_time(payload.time_s)
        if not PERIOD_S[0] <= payload.period_s <= PERIOD_S[1]:
            raise CodecError("a waveform with an impossible period")
        if (np.abs(payload.values) > WILDEST).any():
            raise CodecError("a waveform with values that no sensor has")


_NUMBERS = (*FEATURE_FIELDS, *(f"{phase}.{field}" for phase in PHASES for field in PHASE_FIELDS))
_numbers_of = attrgetter(*_NUMBERS)


class FeatureTopic(BlockTopic[FeatureBlock]):
    """One interval as one row: the fields of FeatureBlock, of its phases and of fast sensors.

    Columns that this version does not know are left unread.
    """

    units = {
        name.replace(".", "_"): next(
            (u for end, u in _UNITS.items() if name.endswith(f"_{end}")), ""
        )
        for name in _NUMBERS
    }

    def check(self, payload: FeatureBlock) -> None:
        numbers = (*_numbers_of(payload), *(each.value for each in payload.vibration))
        if any(map(FURTHEST.__lt__, map(abs, numbers))):
            raise CodecError("an interval with numbers that nobody can measure")
        if not (0.0 < payload.duration_s <= LONGEST_S and abs(payload.time_s) <= LONGEST_S):
            raise CodecError("an interval at an impossible time")

    def to_columns(self, payload: FeatureBlock) -> tuple[dict[str, Floats], Mapping[str, str]]:
        row = dict(zip(self.units, _numbers_of(payload), strict=True))
        row |= {each.name: each.value for each in payload.vibration}
        columns = dict(zip(row, np.array([*row.values()], np.float64)[:, np.newaxis], strict=True))
        return columns, {**self.units, **{each.name: each.unit for each in payload.vibration}}

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> FeatureBlock:
        if self.units.keys() - columns.keys() or len(columns[TIME]) != 1:
            raise CodecError("a block of features without its columns, or without one row")
        values = np.concatenate([*columns.values()]).tolist()
        row: dict[str, Any] = {
            name: value
            for name, value in zip(columns, values, strict=True)
            if name in self.units or "." in name
        }
        for name, most in _MOST_COUNT.items():
            if not (0.0 <= row[name] <= most and row[name].is_integer()):
                raise CodecError(f"{name}: a count that is none")
            row[name] = int(row[name])
        row["fault"] = Fault(row["fault"])
        for phase in PHASES:
            numbers = {field: row.pop(f"{phase}_{field}") for field in PHASE_FIELDS}
            row[phase] = Phase(**numbers)
        fast = [name for name in row if "." in name]
        row["vibration"] = tuple(VibrationColumn(k, row.pop(k), units[k]) for k in fast)
        return FeatureBlock(**row)
