"""Columns of the edge blocks: samples, waveforms and features.

Samples that are not all good bring a column `CHANNEL.quality` of `Quality` codes beside their own.
"""

from collections.abc import Iterable, Mapping
from operator import attrgetter
from struct import Struct
from typing import Any

import numpy as np

from ..channels import CHANNELS, TIME
from ..features import (
    FEATURE_FIELDS,
    PHASE_FIELDS,
    PHASES,
    Fault,
    FeatureBlock,
    Phase,
    VibrationColumn,
)
from ..quality import Qualities
from ..row_faults import WILDEST
from ..samples import Floats, SampleFrame
from ..waveform import Waveform
from .bounded_json import FURTHEST
from .edge_block import BlockCodec
from .interface import CodecError

LONGEST_S = 1e11
"""No clock of an axis shows more, s: some three thousand years."""
PERIOD_S = (1e-7, 10.0)
"""Shortest and longest time between two values of a fast sensor, s."""
_QUALITY = ".quality"
_EVERY_FAULT, _MOST_COUNT = int(~Fault.NONE), 2**31
_INTEGER_FEATURES = frozenset({"sample_count", "reversal_count"})
_PHASE_COLUMNS = {(phase, field): f"{phase}_{field}" for phase in PHASES for field in PHASE_FIELDS}
_LATER_FEATURES = {"steady_direction", *_PHASE_COLUMNS.values()}
"""Columns that version 0.1.0 did not send at first: they come together or not at all."""
_FEATURE_UNITS = {"s": "s", "nm": "N m", "rad": "rad", "m": "m", "c": "degC", "n": "N"}


def _feature_unit(name: str) -> str:
    if name.endswith("rad_s2"):
        return "rad/s^2"
    if name.endswith("rad_s"):
        return "rad/s"
    return _FEATURE_UNITS.get(name.rpartition("_")[2], "")


class SampleCodec(BlockCodec[SampleFrame]):
    """Samples: columns `time_s` and the frame's channels."""

    def to_columns(self, payload: SampleFrame) -> tuple[dict[str, Floats], dict[str, str]]:
        """Columns and units of a frame."""
        columns = {TIME: payload.time_s, **payload.channels}
        columns |= {
            name + _QUALITY: codes.astype(np.float64)
            for name, codes in payload.quality.items()
            if codes.any()
        }
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
    """Tell whether all values are finite and within [-most, most]."""
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


def _whole(value: float, most: int) -> int:
    if not (0.0 <= value <= most and value.is_integer()):
        raise CodecError("a count that is none")
    return int(value)


def _check_interval(time_s: float, duration_s: float, numbers: Iterable[float]) -> None:
    if any(abs(number) > FURTHEST for number in numbers):
        raise CodecError("an interval with numbers that nobody can measure")
    if not (0.0 < duration_s <= LONGEST_S and abs(time_s) <= LONGEST_S):
        raise CodecError("an interval at an impossible time")


def _known_features(columns: dict[str, Floats]) -> dict[str, Floats]:
    """Columns of another version, as far as this one knows them. Raises CodecError."""
    known = {name: column for name, column in columns.items() if name in FeatureCodec.units}
    missing = FeatureCodec.units.keys() - known.keys()
    if missing not in (set(), _LATER_FEATURES):
        raise CodecError("a block of features without columns that every version has")
    return known


class FeatureCodec(BlockCodec[FeatureBlock]):
    """One interval as one row: the fields of FeatureBlock, of its phases and of fast sensors.

    Columns of fast sensors have a dot in their names.
    Columns that this version does not know are left unread; the columns of phases, which the first
    versions did not have, may be missing.
    """

    units = {name: _feature_unit(name) for name in (*FEATURE_FIELDS, *_PHASE_COLUMNS.values())}

    def to_columns(self, payload: FeatureBlock) -> tuple[dict[str, Floats], Mapping[str, str]]:
        """Columns and units of an interval."""
        _, described, body = self.table(payload)
        row = np.frombuffer(body[0], dtype="<f8").reshape(-1, 1)
        return dict(zip(dict(described), row, strict=True)), dict(described)

    def table(self, payload: FeatureBlock) -> tuple[int, tuple[tuple[str, str], ...], list[bytes]]:
        """One row, its columns and bytes."""
        row = _FEATURE_ROW.pack(*_numbers(payload))
        if not payload.vibration:
            return 1, _FEATURE_COLUMNS, [row]
        names, values, units = zip(*payload.vibration, strict=True)
        row += np.array(values, dtype="<f8").tobytes()
        return 1, _FEATURE_COLUMNS + tuple(zip(names, units, strict=True)), [row]

    def holds(self, payload: FeatureBlock) -> bool:
        """Tell whether an interval keeps the bounds of what is read."""
        try:
            numbers = (*_numbers(payload), *(each.value for each in payload.vibration))
            _check_interval(payload.time_s, payload.duration_s, numbers)
        except CodecError:
            return False
        return True

    def from_columns(self, columns: dict[str, Floats], units: Mapping[str, str]) -> FeatureBlock:
        """Interval of columns. Raises CodecError."""
        dotted = [name for name in columns if "." in name]
        fast = {name: columns.pop(name) for name in dotted}
        if columns.keys() != self.units.keys():
            columns = _known_features(columns)
        if len(columns[TIME]) != 1:
            raise CodecError("a block of features with another number of rows than one")
        vibration = tuple(VibrationColumn(k, float(v[0]), units[k]) for k, v in fast.items())
        row = np.concatenate(list(columns.values())).tolist()
        values: dict[str, float] = dict(zip(columns, row, strict=True))
        numbers = (*row, *(each.value for each in vibration))
        _check_interval(values["time_s"], values["duration_s"], numbers)
        integers = {name: _whole(values.pop(name), _MOST_COUNT) for name in _INTEGER_FEATURES}
        fault = Fault(_whole(values.pop("fault"), _EVERY_FAULT))
        phases = {
            phase: Phase(
                **{field: values.pop(_PHASE_COLUMNS[phase, field]) for field in PHASE_FIELDS}
            )
            for phase in PHASES
            if _PHASE_COLUMNS[phase, PHASE_FIELDS[0]] in values
        }
        fields: dict[str, Any] = integers | values | phases
        return FeatureBlock(fault=fault, vibration=vibration, **fields)


_numbers = attrgetter(*FEATURE_FIELDS, *(f"{phase}.{field}" for phase, field in _PHASE_COLUMNS))
"""All numbers of an interval, in the order of the columns."""
_FEATURE_COLUMNS = tuple(FeatureCodec.units.items())
_FEATURE_ROW = Struct(f"<{len(_FEATURE_COLUMNS)}d")
