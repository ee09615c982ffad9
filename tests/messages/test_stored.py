"""Dataclasses through JSON and back, bit for bit, and what is no state of theirs."""

import json
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_service.messages.samples import Floats
from edge_service.messages.stored import Number, Stored, StoredFloats


@dataclass(frozen=True)
class Point:
    x_m: Number
    rows: int = 0
    seen: bool = False


@dataclass(frozen=True)
class Pair:
    first: Point
    second: Point
    noise_m: Number = math.nan


@dataclass
class State:
    number: Number
    since_s: Number
    array: StoredFloats
    logs: StoredFloats
    pair: Pair
    points: dict[str, Point] = field(default_factory=dict)
    count: int = 0
    rows: dict[int, Point] = field(default_factory=dict)


STORED: Stored[State] = Stored(State)
floats = st.floats()


def state(number: float = 1.0, x_m: float = 0.5) -> State:
    pair = Pair(Point(x_m, 3, seen=True), Point(-x_m), number)
    logs: Floats = np.array([0.0, -math.inf, -1.5])
    points = {"a": Point(x_m, 7)}
    return State(number, -math.inf, np.eye(2), logs, pair, points, 4, {-3: Point(x_m)})


def through_json(values: Any) -> Any:
    return json.loads(json.dumps(values, allow_nan=False))


@given(floats, floats)
def test_every_number_comes_back(number: float, x_m: float) -> None:
    kept = through_json(STORED.dump(state(number, x_m)))
    back = STORED.load(kept)
    assert repr(back) == repr(state(number, x_m))
    assert through_json(STORED.dump(back)) == kept
    assert type(back.pair.first.rows) is int
    assert type(back.pair.first.seen) is bool


@pytest.mark.parametrize("name", sorted(STORED.dump(state())))
def test_a_missing_value_is_refused_even_with_a_default(name: str) -> None:
    kept = STORED.dump(state())
    del kept[name]
    with pytest.raises(ValueError, match=f"damaged snapshot.*{name}"):
        STORED.load(kept)


def test_a_missing_value_of_a_part_is_refused_too() -> None:
    kept = STORED.dump(state())
    del kept["pair"]["first"]["seen"]
    with pytest.raises(ValueError, match=r"damaged snapshot: pair\.first\.seen missing"):
        STORED.load(kept)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("number", "x"),
        ("array", "x"),
        ("array", [[1.0], [1.0, 2.0]]),
        ("logs", 1.0),
        ("pair", None),
        ("pair", "?"),
        ("pair", STORED.dump(state())["points"]["a"]),
        ("points", []),
        ("count", 0.5),
    ],
)
def test_a_damaged_value_is_refused_by_its_name(name: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"damaged snapshot: {name}"):
        STORED.load(STORED.dump(state()) | {name: value})


@pytest.mark.parametrize("values", [None, 1.0, [], "x", {}])
def test_what_is_no_state_is_refused(values: Any) -> None:
    with pytest.raises(ValueError, match="damaged snapshot"):
        STORED.load(values)
