"""What a process hands over to itself without decoding is what the bytes say."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from edge_service.bus.publisher import Decoding
from edge_service.config_tables import StoreConfig
from edge_service.messages.codec import Header

from .conftest import config_of, running, until

SUDDEN = {
    "scenario": "sudden",
    "life_s": 10.0,
    "hold_s": 2.0,
    "speed": 10.0,
    "motion": "production",
}


async def test_what_is_handed_over_is_what_is_decoded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """All that a service says of an axis that fails, from features to alarms."""
    handed: Counter[str] = Counter()
    differing: list[tuple[object, object]] = []
    plain = Decoding.sent

    def sent(
        self: Decoding[Any], payload: bytes, axis: str | None, header: Header, value: Any
    ) -> None:
        plain(self, payload, axis, header, value)
        if payload in self._recent:
            name = self._topic.name
            handed[name] += 1
            decoded = self._topic.decode(payload)
            if repr(self._recent[payload]) != repr(decoded):
                differing.append((self._recent[payload], decoded))

    monkeypatch.setattr(Decoding, "sent", sent)
    config = config_of("simulated", SUDDEN, store=StoreConfig(folder=tmp_path))
    async with running(config):

        async def heard() -> bool:
            return handed["event"] > 0 and handed["preload"] > 100

        await until(heard)
    assert not differing
    assert {"feat", "preload", "health", "status", "event"} <= handed.keys()
    assert "raw" not in handed  # samples come from a machine
