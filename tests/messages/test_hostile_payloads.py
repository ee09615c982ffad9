"""Whatever bytes come: a payload of any topic is refused, or it is what its readers count on."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from edge_service.messages.codec import LARGEST, MOST_ENTRIES, MOST_TEXT, CodecError, Header
from edge_service.messages.edge_block import LONGEST_S
from edge_service.messages.features import FeatureBlock
from edge_service.messages.keys import check_part
from edge_service.messages.samples import SampleFrame, Waveform
from edge_service.messages.topics import TOPICS

from .examples import PAYLOADS
from .hostile import example, payloads

EXAMPLES = 300


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, BaseModel):
        value = dict(value)
    if is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in fields(value)}
    if isinstance(value, Mapping):
        assert len(value) <= MOST_ENTRIES
        for key, each in value.items():
            yield from (key, *leaves(each))
    elif isinstance(value, tuple):
        assert len(value) <= MOST_ENTRIES
        for each in value:
            yield from leaves(each)
    else:
        yield value


def check(axis: str, header: Header, payload: Any) -> None:
    """Assert what readers count on."""
    assert axis == "" or check_part(axis)
    numbers = [getattr(header, field.name) for field in fields(header)]
    assert all(type(each) is int and 0 <= each < 2**63 for each in numbers)
    for each in leaves(payload):
        if isinstance(each, str):
            assert len(each) <= MOST_TEXT
            each.encode()
        elif isinstance(each, int):
            assert abs(each) <= LARGEST
        elif isinstance(each, float) and isinstance(payload, BaseModel):
            assert math.isfinite(each)
    if isinstance(payload, SampleFrame):
        assert len(payload)
        assert np.abs(payload.time_s).max() <= LONGEST_S
    if isinstance(payload, Waveform):
        assert 0.0 < payload.period_s <= 10.0
        assert not np.isinf(payload.values).any()
    if isinstance(payload, FeatureBlock):
        assert abs(payload.time_s) <= LONGEST_S
        assert 0.0 < payload.duration_s <= LONGEST_S
        assert min(payload.sample_count, payload.reversal_count) >= 0


@pytest.mark.parametrize("name", list(TOPICS))
def test_an_example_is_what_its_readers_count_on(name: str) -> None:
    assert PAYLOADS.keys() == TOPICS.keys()
    check(*TOPICS[name].decode(example(TOPICS[name])))


@pytest.mark.parametrize("name", list(TOPICS))
def test_hostile_bytes_are_refused_or_are_what_readers_count_on(name: str) -> None:
    topic = TOPICS[name]

    @given(payload=payloads(topic))
    @settings(max_examples=EXAMPLES, deadline=None, derandomize=True, database=None)
    def hold(payload: bytes) -> None:
        try:
            heard = topic.decode(payload)
        except CodecError:
            return
        check(*heard)
        topic.encode(*heard)  # as whoever passes it on will

    hold()


@pytest.mark.parametrize("name", list(TOPICS))
@given(data=st.data())
@settings(max_examples=20, deadline=None, derandomize=True, database=None)
def test_a_payload_of_one_topic_is_none_of_another(name: str, data: st.DataObject) -> None:
    other = data.draw(st.sampled_from([topic for topic in TOPICS.values() if topic.name != name]))
    with pytest.raises(CodecError):
        other.decode(example(TOPICS[name]))
