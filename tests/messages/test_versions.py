"""Versions mixed on one bus: what version 0.1 sent is read today, and what a later one may add.

`version_0_1.json` holds payloads that services of the commits named there put on their bus: 5658023
is the first version 0.1.0 (simulated drive, sudden loss), 89391d3 the one whose change log names it
(with an accelerometer and a note by HTTP); outcomes were encoded by the code of 7cac8fa.
"""

import json
import math
import struct
from base64 import b64decode
from collections.abc import Iterator, Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.messages.codec.interface import CodecError
from edge_service.messages.features import PHASES, Fault, FeatureBlock, Phase
from edge_service.messages.samples import SampleFrame
from edge_service.messages.topics import FEAT, RAW, TOPICS
from edge_service.messages.waveform import Waveform

from .examples import HEADER, PAYLOADS

STORED = json.loads(Path(__file__).with_name("version_0_1.json").read_text())
HEADER_KEYS = ("sequence", "boot_epoch", "source_time_ns", "monotonic_time_ns")
BLOCKS = {"raw", "feat", "wave"}


def parsed(payload: bytes) -> tuple[dict[str, Any], dict[str, list[float]]]:
    """Members and columns of a payload, by the standard library alone."""
    if payload[:4] != b"EDB1":
        return json.loads(payload), {}
    (length,) = struct.unpack_from("<I", payload, 4)
    members = json.loads(payload[8 : 8 + length])
    names, rows = [name for name, _unit in members["columns"]], members["rows"]
    numbers = struct.unpack_from(f"<{rows * len(names)}d", payload, 8 + length)
    return members, {
        name: list(numbers[at * rows : (at + 1) * rows]) for at, name in enumerate(names)
    }


def test_every_topic_is_stored() -> None:
    assert {each["topic"] for each in STORED} == set(TOPICS)


@pytest.mark.parametrize("number", range(len(STORED)))
def test_what_version_0_1_sent_is_read_with_the_same_values(number: int) -> None:
    stored = STORED[number]
    written = b64decode(stored["payload"])
    members, columns = parsed(written)
    axis, header, payload = TOPICS[stored["topic"]].decode(written)
    assert axis == (members["axis"] or "")
    assert {key: getattr(header, key) for key in HEADER_KEYS} == {
        key: members[key] for key in HEADER_KEYS
    }
    if columns:
        assert list(wrong_columns(payload, columns)) == []
    else:
        sent = {k: v for k, v in members.items() if k not in (*HEADER_KEYS, "schema")}
        assert list(wrong_members(payload, sent, "")) == []


def wrong_members(told: Any, sent: Any, where: str) -> Iterator[str]:
    """Places at which a decoded message says something else than the JSON that was sent."""
    if isinstance(sent, dict):
        for name, value in sent.items():
            if where or name != "axis":
                found = told[name] if isinstance(told, Mapping) else getattr(told, name)
                yield from wrong_members(found, value, f"{where}.{name}")
    elif isinstance(sent, list):
        if len(told) != len(sent):
            yield where
        for at, (one, other) in enumerate(zip(told, sent, strict=False)):
            yield from wrong_members(one, other, f"{where}[{at}]")
    elif (told.value if isinstance(told, Enum) else told) != sent:
        yield where


def wrong_columns(payload: object, columns: dict[str, list[float]]) -> Iterator[str]:
    """Columns of a block that a decoded payload does not hold as they were sent."""
    for name, sent in columns.items():
        told = np.atleast_1d(np.asarray(column_of(payload, name), dtype=float))
        if not np.allclose(told, sent, rtol=1e-12, atol=1e-12, equal_nan=True):
            yield name


def column_of(payload: object, name: str) -> Any:
    if isinstance(payload, SampleFrame):
        return payload.time_s if name == "time_s" else payload.channels[name]
    if isinstance(payload, Waveform):
        return payload.time_s if name == "time_s" else payload.values
    assert isinstance(payload, FeatureBlock)
    phase = next((each for each in PHASES if name.startswith(f"{each}_")), None)
    if phase is None:
        return getattr(payload, name)
    return getattr(getattr(payload, phase), name.removeprefix(f"{phase}_"))


def first_features() -> FeatureBlock:
    written = next(each for each in STORED if each["topic"] == "feat")
    assert written["commit"] == "5658023"
    block = FEAT.decode(b64decode(written["payload"]))[2]
    assert isinstance(block, FeatureBlock)
    return block


def test_an_interval_of_the_first_version_has_no_phases() -> None:
    block = first_features()
    assert block.phases == ()
    assert block.steady_direction == 0.0
    assert repr(block.cruising) == repr(Phase())
    assert math.isnan(block.cruising.torque_nm)


def with_columns(payload: bytes, change: dict[str, list[float] | None]) -> bytes:
    """A block with columns added, replaced, or taken away (None)."""
    members, columns = parsed(payload)
    units = dict(members["columns"])
    columns = {n: c for n, c in (columns | change).items() if c is not None}
    members["columns"] = [[name, units.get(name, "")] for name in columns]
    text = json.dumps(members).encode()
    body = b"".join(struct.pack(f"<{len(column)}d", *column) for column in columns.values())
    return struct.pack("<4sI", b"EDB1", len(text)) + text + body


def test_columns_of_a_later_version_are_left_unread() -> None:
    written = FEAT.encode("X", HEADER, PAYLOADS["feat"])
    later = with_columns(written, {"of_a_later_version_nm": [1.0]})
    assert later != written
    assert repr(FEAT.decode(later)) == repr(FEAT.decode(written))


@pytest.mark.parametrize("name", ["torque_mean_nm", "fault", "steady_direction", "braking_table_m"])
def test_a_block_without_a_column_that_belongs_to_it_is_refused(name: str) -> None:
    written = FEAT.encode("X", HEADER, PAYLOADS["feat"])
    with pytest.raises(CodecError, match="every version has"):
        FEAT.decode(with_columns(written, {name: None}))


def test_a_fault_that_this_version_does_not_know_is_refused() -> None:
    """It may make the numbers worthless, and nobody here could tell."""
    written = FEAT.encode("X", HEADER, PAYLOADS["feat"])
    unknown = float(int(~Fault.NONE) + 1)
    with pytest.raises(CodecError):
        FEAT.decode(with_columns(written, {"fault": [unknown]}))


def test_channels_of_a_later_version_are_handed_on() -> None:
    written = RAW.encode("X", HEADER, PAYLOADS["raw"])
    rows = parsed(written)[0]["rows"]
    frame = RAW.decode(with_columns(written, {"later_channel": [1.5] * rows}))[2]
    assert isinstance(frame, SampleFrame)
    assert frame.channels["later_channel"].tolist() == [1.5] * rows


def with_member(payload: bytes) -> bytes:
    return json.dumps(json.loads(payload) | {"of_a_later_version": 1}).encode()


@pytest.mark.parametrize("name", sorted(set(TOPICS) - BLOCKS))
def test_nodes_of_one_machine_refuse_members_that_they_do_not_know(name: str) -> None:
    """So the nodes of one machine are upgraded together, as the operators' guide says."""
    axis = None if name == "status" else "X"
    written = TOPICS[name].encode(axis, HEADER, PAYLOADS[name])
    with pytest.raises(CodecError):
        TOPICS[name].decode(with_member(written))
