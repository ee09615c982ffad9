"""A service whose kernels are being compiled says so, from the node to the condition."""

import asyncio
import threading
from pathlib import Path
from unittest.mock import AsyncMock

import numba
import pytest

from edge_service.messages.health import Task
from edge_service.messages.topics import HEALTH
from edge_service.nodes import stages

from .conftest import PATIENCE_S, config_of, running


async def test_the_condition_waits_for_the_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = threading.Event()
    monkeypatch.setattr(stages, "warm_up", lambda *_args: compiled.wait(PATIENCE_S))
    config = config_of("simulated", {})
    try:
        async with running(config, ("health", "estimate")) as service:
            heard = service.bus.subscribe(config.keys.all_axes(HEALTH), HEALTH)
            async with asyncio.timeout(PATIENCE_S):
                seen = []
                async for _, _, health in heard:
                    seen.append(health.reasons[0])
                    if seen[-1] == f"preparing: {stages.PREPARING}":
                        assert [each.task for each in health.advice] == [Task.WAIT]
                        compiled.set()
                    elif compiled.is_set():
                        break
            assert seen[-1].startswith("no_input")
    finally:
        compiled.set()


async def test_kernels_are_compiled_once_in_a_process_that_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(stages, "finished", finished := AsyncMock(side_effect=[(1, ""), (0, "")]))
    monkeypatch.setattr(stages, "warm_up", lambda *_args: None)
    config = config_of("simulated", {}).of_file(tmp_path / "edge.toml")
    for _ in range(3):
        await stages.prepare(config, tuple(stages.load_machines(config).values()))
    assert finished.await_count == 2
