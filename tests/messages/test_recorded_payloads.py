"""Every payload on the wire is, byte by byte, the one that version 0.1.0 sent."""

import json
from base64 import b64decode
from pathlib import Path

import pytest

from edge_service.messages.topics import TOPICS

from .examples import HEADER, PAYLOADS

RECORDED = json.loads(Path(__file__).with_name("recorded_payloads.json").read_text())


@pytest.mark.parametrize("name", list(TOPICS))
def test_the_bytes_of_every_topic_stay(name: str) -> None:
    topic, recorded = TOPICS[name], b64decode(RECORDED[name])
    axis = None if name == "status" else "X"
    assert topic.encode(axis, HEADER, PAYLOADS[name]) == recorded
    heard, header, payload = topic.decode(recorded)
    assert (heard, header) == (axis or "", HEADER)
    assert repr(topic.encode(axis, header, payload)) == repr(recorded)
