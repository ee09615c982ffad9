"""A service whose kernels are being compiled says so, from the node to the condition."""

import asyncio
import threading

import pytest

from edge_service.messages.health import Task
from edge_service.messages.topics import HEALTH
from edge_service.nodes import estimate_node

from .conftest import PATIENCE_S, config_of, running


async def test_the_condition_waits_for_the_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = threading.Event()
    monkeypatch.setattr(estimate_node, "warm_up", lambda *_args: compiled.wait(PATIENCE_S))
    config = config_of("simulated", {})
    try:
        async with running(config, ("health", "estimate")) as service:
            heard = service.bus.subscribe(config.keys.all_axes(HEALTH), HEALTH)
            async with asyncio.timeout(PATIENCE_S):
                seen = []
                async for _, _, health in heard:
                    seen.append(health.reasons[0])
                    if seen[-1] == f"preparing: {estimate_node.PREPARING}":
                        assert [each.task for each in health.advice] == [Task.WAIT]
                        compiled.set()
                    elif compiled.is_set():
                        break
            assert seen[-1].startswith("no_input")
    finally:
        compiled.set()
