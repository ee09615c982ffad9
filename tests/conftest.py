"""Linear algebra on one thread, here and in every process that a test starts; no lines of progress.

The matrices are small: threads that wait for one another take many times as long as one alone as
soon as the machine has other work. Lines that come every 10 s would depend on how busy it is.
"""

import os
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_name, "1")


@pytest.fixture(autouse=True)
def quiet_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands that a test calls in its own process say errors alone."""
    monkeypatch.setattr("edge_service.cli.terminal.PIPE_S", 3600.0)
    monkeypatch.delenv("EDGE_SERVICE_PROGRESS", raising=False)


@pytest.fixture
def machine() -> Any:
    """The thesis' test bench."""
    from edge_service.config import DEFAULT_MACHINE, load_machine

    return load_machine(DEFAULT_MACHINE)


@pytest.fixture
async def broker(tmp_path: Path) -> AsyncIterator[Any]:
    """MQTT's mosquitto, for this test alone."""
    from .drivers.mqtt.broker import Broker

    made = Broker(tmp_path)
    await made.start()
    yield made
    await made.stop()
