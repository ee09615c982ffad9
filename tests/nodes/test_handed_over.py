"""What a process decodes once for all its readers is what the bytes say, and nobody changes it."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from edge_service.bus.publisher import Decoding
from edge_service.config_tables import StoreConfig

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
    heard: Counter[str] = Counter()
    shared: Counter[str] = Counter()
    differing: list[tuple[object, object]] = []
    plain = Decoding.decode

    def decode(self: Decoding[Any], payload: bytes) -> Any:
        (shared if payload in self._recent else heard)[self._topic.name] += 1
        axis, header, value = given = plain(self, payload)
        decoded = self._topic.decode(payload)
        if repr(given) != repr(decoded):
            differing.append((given, decoded))
        if (again := self._topic.encode(axis or None, header, value)) != payload:
            differing.append((again, payload))
        return given

    monkeypatch.setattr(Decoding, "decode", decode)
    config = config_of("simulated", SUDDEN, store=StoreConfig(folder=tmp_path))
    async with running(config):

        async def told() -> bool:
            return shared["event"] > 0 and shared["preload"] > 100 and heard["health"] > 0

        await until(told)
    assert not differing
    assert {"raw", "feat", "preload", "health", "status", "event"} <= heard.keys()
    assert {"feat", "preload", "status", "event"} <= shared.keys()
