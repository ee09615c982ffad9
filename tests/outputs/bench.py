"""Contract of an output's own folder with the behaviour suite."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edge_service.messages.event import AxisCondition, Event
from edge_service.outputs.base import Output, OutputContext, load_output

from ..messages.answers import MEASURED_NS

SECRET = "hush-hush-1234"
"""Part of every secret in these tests."""


@dataclass(frozen=True, slots=True)
class OutputBench:
    make: Callable[[], Output]  # a new output for the other side
    heard: Callable[[], Awaitable[bool]]  # whether the other side has heard of axis X
    # lose, bring_back: take the other side away, or what the output needs to listen
    lose: Callable[[], Awaitable[None]]
    bring_back: Callable[[], Awaitable[None]]
    # an output whose other side answers nothing; None where there is none
    hanging: Callable[[], Output] | None = None
    # an output whose other side takes no event; None where there is none
    refusing: Callable[[], Output] | None = None


def output(name: str, table: dict[str, Any], folder: Path | None = None, **facts: Any) -> Output:
    kind = load_output(name)
    context = OutputContext(name, "hall", "mill", ("X", "Y"), folder, **facts)
    return kind(kind.config_model.model_validate(table), context)


def event(message: str = "preload at 47 %", kind: str = "alarm_raised", axis: str = "X") -> Event:
    return Event(
        axis=axis, kind=kind, level=AxisCondition.WARNING, text=message, time_ns=MEASURED_NS
    )


class PortTaker:
    """Another process' listener, in whose way an output that listens is."""

    def __init__(self, port: int) -> None:
        self.port = port
        self._server: asyncio.Server | None = None

    async def start(self) -> None:
        self._server = await asyncio.start_server(lambda _r, w: w.close(), "127.0.0.1", self.port)

    async def stop(self) -> None:
        if self._server is not None:
            self._server.close()
            self._server = None


@asynccontextmanager
async def silent_peer() -> AsyncIterator[int]:
    """Port of a peer that takes connections and says nothing."""
    gone = asyncio.Event()

    async def hold(_reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await gone.wait()
        writer.close()

    server = await asyncio.start_server(hold, "127.0.0.1", 0)
    try:
        yield int(server.sockets[0].getsockname()[1])
    finally:
        gone.set()
        server.close()
