"""Payloads as a damaged link or a hostile program would send them: made of the examples."""

import json
import struct
from contextlib import suppress
from typing import Any

import numpy as np
from hypothesis import strategies as st

from edge_service.messages.codec import Topic
from edge_service.messages.edge_block import BLOCK_ENCODING, MAGIC
from edge_service.messages.topics import TOPICS

from .examples import HEADER, PAYLOADS

NASTY: list[Any] = [
    *(None, True, -1, 0, 1, 2**31, 2**53, 2**63 - 1, 2**63, 2**64, -(2**63), 10**40),
    *(1.5, 1e308, -1e308, 5e-324, float("nan"), float("inf"), -float("inf")),
    *("", "X", "Y", "../..", "../axis=X/hour/2026.parquet", "\ud800", "\x00", "a" * 10_000),
    *([], {}, ["X"], {"X": 1}, [[]], "1", "disagreement_Y_20260101T000000Z.parquet"),
]
"""Members in place of the right ones."""
NUMBERS = [
    *(float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e300, 5e-324, 1e12, 1e11),
    *(-1.0, 0.0, 0.5, 1e9, 1e18, 2.0**31, 2.0**63),
]
"""Numbers in place of measured ones."""


def example(topic: Topic[Any]) -> bytes:
    """A good payload of axis X, or of a component that serves all."""
    return topic.encode(None if topic.name == "status" else "X", HEADER, PAYLOADS[topic.name])


def payloads(topic: Topic[Any]) -> st.SearchStrategy[bytes]:
    good = example(topic)
    inside = _blocks if topic.encoding == BLOCK_ENCODING else _messages

    def flip(bits: list[int]) -> bytes:
        damaged = bytearray(good)
        for bit in bits:
            damaged[bit // 8] ^= 1 << bit % 8
        return bytes(damaged)

    return st.one_of(
        st.binary(max_size=200),
        st.integers(0, len(good)).map(lambda end: good[:end]),
        st.lists(st.integers(0, 8 * len(good) - 1), min_size=1, max_size=8).map(flip),
        inside(good),
        inside(good),
        inside(good),
    )


def hostile() -> st.SearchStrategy[tuple[str, bytes]]:
    """Topic and payload, of every topic of the table."""
    return st.sampled_from(sorted(TOPICS)).flatmap(
        lambda name: st.tuples(st.just(name), payloads(TOPICS[name]))
    )


def _bytes(value: Any) -> bytes:
    return json.dumps(value).encode()


def places(value: Any, most: int | None = None, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place in a document, of lists the first `most`."""
    if not isinstance(value, dict | list):
        return []
    found = []
    for key, each in value.items() if isinstance(value, dict) else enumerate(value[:most]):
        found += [(*at, key), *places(each, most, (*at, key))]
    return found


def replaced(value: Any, changes: list[tuple[tuple[Any, ...], Any]]) -> Any:
    """The document with something else at some places; at () it is that alone."""
    copy = json.loads(json.dumps(value))
    for path, new in changes:
        if not path:
            return new
        place = copy
        with suppress(LookupError, TypeError):  # an earlier change has taken the place away
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = new
    return copy


def _changes(value: Any) -> st.SearchStrategy[list[tuple[tuple[Any, ...], Any]]]:
    change = st.tuples(st.sampled_from(places(value)), st.sampled_from(NASTY))
    return st.lists(change, min_size=1, max_size=3)


def _messages(good: bytes) -> st.SearchStrategy[bytes]:
    members = json.loads(good)
    return _changes(members).map(lambda changes: _bytes(replaced(members, changes)))


def _blocks(good: bytes) -> st.SearchStrategy[bytes]:
    (length,) = struct.unpack_from("<I", good, 4)
    members, body = json.loads(good[8 : 8 + length]), np.frombuffer(good[8 + length :], "<f8")

    def block(changes: list[Any], numbers: list[tuple[int, float]], cut: int | None) -> bytes:
        text, values = _bytes(replaced(members, changes)), body.copy()
        for index, number in numbers:
            values[index] = number
        return MAGIC + struct.pack("<I", len(text)) + text + values[:cut].tobytes()

    number = st.tuples(st.integers(0, body.size - 1), st.sampled_from(NUMBERS))
    none: st.SearchStrategy[list[Any]] = st.just([])
    return st.builds(
        block,
        st.one_of(none, none, _changes(members)),
        st.lists(number, max_size=6),
        st.one_of(st.none(), st.none(), st.integers(0, body.size)),
    )
