"""Payloads survive the wire, and foreign bytes are refused."""

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from edge_service.messages.codec import CodecError
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.features import Fault, FeatureBlock, VibrationColumn
from edge_service.messages.samples import ANGLE, TORQUE, SampleFrame
from edge_service.messages.topics import EVENT, FEAT, PRELOAD, RAW

from .examples import HEADER, NUMBERS, PAYLOADS, event_of

BLOCK = FeatureBlock(**NUMBERS)


def samples(rows: int = 5) -> SampleFrame:
    time_s = np.arange(rows) * 1e-3
    return SampleFrame(time_s, {TORQUE: np.sin(time_s), ANGLE: np.full(rows, np.nan)})


def test_samples_come_back_bit_equal() -> None:
    axis, header, frame = RAW.decode(RAW.encode("X", HEADER, samples()))
    assert (axis, header) == ("X", HEADER)
    np.testing.assert_array_equal(frame.time_s, samples().time_s)
    assert list(frame.channels) == [TORQUE, ANGLE]
    for name, values in samples().channels.items():
        np.testing.assert_array_equal(frame.channels[name], values)


def test_features_come_back_equal() -> None:
    axis, header, decoded = FEAT.decode(FEAT.encode("Y", HEADER, BLOCK))
    assert (axis, header) == ("Y", HEADER)
    assert repr(decoded) == repr(BLOCK)
    assert decoded.fault is Fault.HOLE | Fault.REPEAT


def test_a_block_can_be_read_with_the_standard_library_alone() -> None:
    payload = RAW.encode("X", HEADER, samples(2))
    magic, length = struct.unpack_from("<4sI", payload)
    members = json.loads(payload[8 : 8 + length])
    assert magic == b"EDB1"
    assert (members["sequence"], members["columns"][1]) == (HEADER.sequence, [TORQUE, "N m"])
    values = struct.unpack_from("<2d", payload, 8 + length)
    assert values == (0.0, 1e-3)


def test_every_feature_with_a_dimension_has_a_unit() -> None:
    bare = {name for name, unit in FEAT.units.items() if not unit}
    assert " ".join(sorted(bare)) == (
        "direction_lever direction_mean fault moving_fraction "
        "reversal_count sample_count steady_direction"
    )
    assert FEAT.units["braking_acceleration_rad_s2"] == "rad/s^2"
    assert (FEAT.units["speed_end_rad_s"], FEAT.units["torque_mean_nm"]) == ("rad/s", "N m")


def test_json_payloads_come_back_equal() -> None:
    payload = PRELOAD.encode("X", HEADER, PAYLOADS["preload"])
    assert PRELOAD.decode(payload) == ("X", HEADER, PAYLOADS["preload"])
    event = event_of(time_ns=1_790_000_000_123_456_789)
    payload = EVENT.encode("X", HEADER, event)
    assert EVENT.decode(payload) == ("X", HEADER, event)


def test_numbers_that_are_none_are_not_finite() -> None:
    with pytest.raises(ValueError, match="finite"):
        PreloadEstimate(time_s=float("nan"), status=EstimateStatus.ESTIMATED)


@pytest.mark.parametrize("depth", [100_000])
def test_deep_nesting_is_refused_like_any_other_garbage(depth: int) -> None:
    nested = b"[" * depth
    for decode in (RAW.decode, FEAT.decode):
        with pytest.raises(CodecError):
            decode(b"EDB1" + struct.pack("<I", depth) + nested)
    with pytest.raises(CodecError):
        PRELOAD.decode(nested)


@pytest.mark.parametrize(
    "rewritten",
    [
        json.dumps,
        lambda members: json.dumps(dict(reversed(members.items()))),
        lambda members: json.dumps(members, separators=(",", ":")),
        lambda members: json.dumps(members, indent=1),
        lambda members: json.dumps({"note": {"a": [1], "columns": [["x", ""]]}} | members),
        lambda members: json.dumps(members | {"note": 1}),
    ],
)
def test_the_header_of_a_block_may_be_written_in_any_way(rewritten: Any) -> None:
    payload = RAW.encode("X", HEADER, samples())
    (length,) = struct.unpack_from("<4xI", payload)
    text = rewritten(json.loads(payload[8 : 8 + length])).encode()
    other = b"EDB1" + struct.pack("<I", len(text)) + text + payload[8 + length :]
    axis, header, frame = RAW.decode(other)
    assert (axis, header) == ("X", HEADER)
    assert list(frame.channels) == [TORQUE, ANGLE]
    np.testing.assert_array_equal(frame.time_s, samples().time_s)


@pytest.mark.parametrize(
    "columns", ['[["time_s"]]', '[["a/b", "s"]]', "[]", '[["x", ""], ["x", ""]]']
)
def test_columns_that_are_none_are_refused_every_time(columns: str) -> None:
    text = f'{{"schema": "samples/1", "axis": "X", "rows": 0, "columns": {columns}}}'.encode()
    for _ in range(2):
        with pytest.raises(CodecError, match="column"):
            RAW.decode(b"EDB1" + struct.pack("<I", len(text)) + text)


def test_columns_of_fast_sensors_travel_with_the_block_that_follows_them() -> None:
    columns = (VibrationColumn("nut.rms", 0.5, "m/s^2"), VibrationColumn("nut.kurtosis", 3.0, ""))
    sent = replace(BLOCK, vibration=columns)
    _, _, found = FEAT.decode(FEAT.encode("X", HEADER, sent))
    assert found.vibration == columns
    wild = replace(sent, vibration=(VibrationColumn("nut.rms", 1e300, ""),))
    with pytest.raises(CodecError):
        FEAT.decode(FEAT.encode("X", HEADER, wild))
