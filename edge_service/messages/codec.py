"""Bytes on the wire, both ways.

Binary payloads (`raw`, `feat`) are *edge blocks*, readable with a standard library alone::

    bytes 0..3    b"EDB1"
    bytes 4..7    length H of the header, unsigned 32 bit, little endian
    bytes 8..8+H  header, UTF-8 JSON: {"schema", "axis", "sequence", "boot_epoch",
                  "source_time_ns", "monotonic_time_ns", "rows", "columns": [[name, unit], ...]}
    then          per column `rows` little-endian float64 values, column after column

Samples that are not all good bring a column `CHANNEL.quality` of `Quality` codes beside their own.
Integers and flags travel as float64 too (all are far below 2**53). JSON payloads are objects with
the members of the header beside those of the payload, and a `schema` member.
"""

import json
import struct
from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from .channels import CHANNELS, TIME
from .estimate import Frozen
from .features import FEATURE_FIELDS, PHASE_FIELDS, PHASES, Fault, FeatureBlock, Phase
from .header import Header
from .quality import Qualities
from .samples import Floats, SampleFrame
from .topics import FEAT, RAW, WAVE
from .waveform import Waveform

MAGIC = b"EDB1"
_PREFIX = struct.Struct("<4sI")
_HEADER_KEYS = ("sequence", "boot_epoch", "source_time_ns", "monotonic_time_ns")
_QUALITY = ".quality"
_INTEGER_FEATURES = frozenset({"sample_count", "reversal_count"})
_PHASE_COLUMNS = {(phase, field): f"{phase}_{field}" for phase in PHASES for field in PHASE_FIELDS}
_FEATURE_UNITS = {"s": "s", "nm": "N m", "rad": "rad", "m": "m", "c": "degC", "n": "N"}
_Payload = TypeVar("_Payload", bound=Frozen)


def _feature_unit(name: str) -> str:
    if name.endswith("rad_s2"):
        return "rad/s^2"
    if name.endswith("rad_s"):
        return "rad/s"
    return _FEATURE_UNITS.get(name.rpartition("_")[2], "")


FEATURE_UNITS = {name: _feature_unit(name) for name in (*FEATURE_FIELDS, *_PHASE_COLUMNS.values())}
"""Unit of each column of a block of features."""


class CodecError(ValueError):
    """Bytes that are no payload of ours."""


def encode_samples(axis: str, header: Header, frame: SampleFrame) -> bytes:
    """Samples as an edge block; columns `time_s` and the frame's channels."""
    columns = {TIME: frame.time_s, **frame.channels}
    columns |= {
        name + _QUALITY: codes.astype(np.float64)
        for name, codes in frame.quality.items()
        if codes.any()
    }
    units = {name: CHANNELS[name].unit if name in CHANNELS else "" for name in columns}
    return _encode_block(RAW.payload, axis, header, columns, units | {TIME: "s"})


def decode_samples(payload: bytes) -> tuple[str, Header, SampleFrame]:
    """Axis, header and samples of an edge block; CodecError if it is none."""
    axis, header, columns = _decode_block(RAW.payload, payload)
    if TIME not in columns:
        raise CodecError("a block of samples without time_s")
    time_s = columns.pop(TIME)
    quality = {
        name.removesuffix(_QUALITY): _codes(columns.pop(name))
        for name in [name for name in columns if name.endswith(_QUALITY)]
    }
    try:
        return axis, header, SampleFrame(time_s, columns, quality)
    except ValueError as error:
        raise CodecError(f"a block of samples: {error}") from None


def _codes(column: Floats) -> Qualities:
    if not ((column >= 0.0) & (column <= 255.0)).all():
        raise CodecError("a quality that is no code")
    return column.astype(np.uint8)


def encode_waveform(axis: str, header: Header, wave: Waveform) -> bytes:
    """A piece of a fast sensor's signal as an edge block; columns `time_s` and the sensor."""
    columns = {TIME: wave.time_s, wave.sensor: wave.values}
    return _encode_block(WAVE.payload, axis, header, columns, {TIME: "s", wave.sensor: wave.unit})


def decode_waveform(payload: bytes) -> tuple[str, Header, Waveform]:
    """Axis, header and signal of an edge block; CodecError if it is none."""
    axis, header, columns = _decode_block(WAVE.payload, payload)
    units = json.loads(payload[_PREFIX.size : _PREFIX.size + _PREFIX.unpack_from(payload)[1]])
    time_s = columns.pop(TIME, None)
    if time_s is None or len(columns) != 1 or len(time_s) < 2 or not time_s[-1] > time_s[0]:
        raise CodecError("a waveform without a clock and one sensor")
    ((sensor, values),) = columns.items()
    unit = next(str(unit) for name, unit in units["columns"] if name == sensor)
    period_s = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    return axis, header, Waveform(sensor, unit, float(time_s[0]), period_s, values)


def encode_features(axis: str, header: Header, block: FeatureBlock) -> bytes:
    """One interval as an edge block of one row: the fields of FeatureBlock and of its phases."""
    columns = {name: np.array([float(getattr(block, name))]) for name in FEATURE_FIELDS}
    for (phase, field), name in _PHASE_COLUMNS.items():
        columns[name] = np.array([float(getattr(getattr(block, phase), field))])
    return _encode_block(FEAT.payload, axis, header, columns, FEATURE_UNITS)


def decode_features(payload: bytes) -> tuple[str, Header, FeatureBlock]:
    """Axis, header and interval of an edge block; CodecError if it is none."""
    axis, header, columns = _decode_block(FEAT.payload, payload)
    if set(columns) != set(FEATURE_UNITS) or any(len(c) != 1 for c in columns.values()):
        raise CodecError("a block of features with other columns than this version's")
    values: dict[str, float] = {name: float(column[0]) for name, column in columns.items()}
    integers = {name: int(values.pop(name)) for name in _INTEGER_FEATURES}
    fault = Fault(int(values.pop("fault")))
    phases = {
        phase: Phase(**{field: values.pop(_PHASE_COLUMNS[phase, field]) for field in PHASE_FIELDS})
        for phase in PHASES
    }
    fields: dict[str, Any] = integers | values | phases
    return axis, header, FeatureBlock(fault=fault, **fields)


def encode_json(schema: str, axis: str | None, header: Header, payload: Frozen) -> bytes:
    """A JSON payload with its axis and header."""
    members = {"schema": schema, "axis": axis}
    members |= {key: getattr(header, key) for key in _HEADER_KEYS}
    return json.dumps(members | payload.model_dump(mode="json"), allow_nan=False).encode()


def decode_json(schema: str, model: type[_Payload], payload: bytes) -> tuple[str, Header, _Payload]:
    """Axis (empty if none), header and payload of a JSON message; CodecError if it is another."""
    try:
        members = json.loads(payload)
        if not isinstance(members, dict) or members.pop("schema", None) != schema:
            raise CodecError(f"no {schema} message")
        header = _header_from(members)
        axis = members["axis"] if "axis" in model.model_fields else members.pop("axis")
        return axis or "", header, model.model_validate_json(json.dumps(members))
    except CodecError:
        raise
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise CodecError(f"no {schema} message: {error}") from error


def _encode_block(
    schema: str, axis: str, header: Header, columns: Mapping[str, Floats], units: Mapping[str, str]
) -> bytes:
    rows = len(next(iter(columns.values())))
    text = json.dumps(
        {"schema": schema, "axis": axis}
        | {key: getattr(header, key) for key in _HEADER_KEYS}
        | {"rows": rows, "columns": [[name, units.get(name, "")] for name in columns]}
    ).encode()
    body = [np.ascontiguousarray(column, dtype="<f8").tobytes() for column in columns.values()]
    return b"".join([_PREFIX.pack(MAGIC, len(text)), text, *body])


def _decode_block(schema: str, payload: bytes) -> tuple[str, Header, dict[str, Floats]]:
    try:
        magic, length = _PREFIX.unpack_from(payload)
        if magic != MAGIC:
            raise CodecError("no edge block: wrong first four bytes")
        start = _PREFIX.size + length
        members = json.loads(payload[_PREFIX.size : start])
        if members["schema"] != schema:
            raise CodecError(f"a {members['schema']} block where {schema} was expected")
        names = [str(name) for name, _unit in members["columns"]]
        rows = int(members["rows"])
        table = np.frombuffer(payload, dtype="<f8", offset=start)
        if rows < 0 or table.size != rows * len(names) or len(set(names)) != len(names):
            raise CodecError("an edge block whose size contradicts its header")
        columns = dict(zip(names, table.reshape(len(names), rows).astype(np.float64), strict=True))
        return str(members["axis"]), _header_from(members), columns
    except CodecError:
        raise
    except (ValueError, KeyError, TypeError, RecursionError, struct.error) as error:
        raise CodecError(f"no edge block: {error}") from error


def _header_from(members: dict[str, object]) -> Header:
    values = [members.pop(key, None) for key in _HEADER_KEYS]
    numbers = [each for each in values if isinstance(each, int) and not isinstance(each, bool)]
    if len(numbers) < len(_HEADER_KEYS):
        raise CodecError("a header without its four integers")
    return Header(*numbers)
