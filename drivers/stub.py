"""Stub servers: an axis of another driver served over the real protocol, with faults on demand.

A stub is found by the name of its protocol in the entry-point group `edge_service.stubs`.
"""

import asyncio
from collections.abc import AsyncGenerator, Callable, Sequence
from contextlib import aclosing
from dataclasses import dataclass, field
from enum import StrEnum, auto
from typing import Any, Protocol

from edge_service.messages.samples import SampleFrame

from .base import DriverContext, DriverMisconfiguredError

ENTRY_POINT_GROUP = "edge_service.stubs"


class FaultKind(StrEnum):
    """Kinds of fault that a stub can simulate."""

    NONE = auto()
    DELAY = auto()  # answers late, by `amount` seconds
    EXCEPTION = auto()  # refuses, with code `amount` (Modbus) or a bad status (OPC UA)
    STALE = auto()  # repeats the values of now
    DROP = auto()  # hangs up, at every request
    WORD_ORDER = auto()  # exchanges the words of longer numbers (Modbus)
    HANG = auto()  # takes requests and never answers


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault with its amount: seconds of a delay, code of an exception."""

    kind: FaultKind = FaultKind.NONE
    amount: float = 0.0


DEFAULT_AMOUNTS = {FaultKind.DELAY: 0.3, FaultKind.EXCEPTION: 4.0}


def parse_fault(text: str) -> Fault:
    """`delay`, `delay:0.3`, `exception:2`, ... Raises ValueError."""
    name, _, amount = text.partition(":")
    if name not in list(FaultKind):
        raise ValueError(f"no fault {name!r}; expected one of {', '.join(FaultKind)}")
    kind = FaultKind(name)
    try:
        return Fault(kind, float(amount) if amount else DEFAULT_AMOUNTS.get(kind, 0.0))
    except ValueError:
        raise ValueError(f"fault {text!r}: {amount!r} is no number") from None


@dataclass(slots=True)
class StubAxis:
    """One axis of a stub: what its driver reads, where its samples come from, and the latest."""

    name: str
    config: Any
    context: DriverContext
    source: AsyncGenerator[SampleFrame, None]
    # channel -> value in SI units; empty before the first sample
    latest: dict[str, float] = field(default_factory=dict)
    samples: int = 0  # how many samples there were
    begun: asyncio.Event = field(default_factory=asyncio.Event)  # set with the first one

    async def follow(self) -> None:
        """Keep `latest` up to date until the source ends."""
        try:
            async with aclosing(self.source) as frames:
                async for frame in frames:
                    if len(frame):
                        self.latest = {name: float(v[-1]) for name, v in frame.channels.items()}
                        self.samples += len(frame)
                        self.begun.set()
        finally:
            self.begun.set()  # a source without samples must not keep anybody waiting


class Stub(Protocol):
    """A server of one protocol."""

    fault: Fault

    def __init__(self, axes: Sequence[StubAxis]) -> None: ...

    async def start(self) -> str:
        """Listen; returns the address. Raises DriverMisconfiguredError."""

    async def close(self) -> None:
        """Hang up on everybody; safe twice."""


class Following:
    """The tasks that keep the axes of a stub, which share an address, up to date.

    Args:
        address: of a configuration. Raises DriverMisconfiguredError where they differ.
    """

    def __init__(self, axes: Sequence[StubAxis], address: Callable[[Any], object]) -> None:
        for axis in axes:
            if address(axis.config) != address(axes[0].config):
                words = f"axis {axis.name} has another address than {axes[0].name}; choose --axis"
                raise DriverMisconfiguredError("url", words)
        self._axes = axes
        self._tasks: list[asyncio.Task[None]] = []

    async def start(self) -> None:
        """Begin to follow every axis, and wait for the first sample of each."""
        self._tasks = [asyncio.create_task(axis.follow()) for axis in self._axes]
        await asyncio.gather(*(axis.begun.wait() for axis in self._axes))

    async def close(self) -> None:
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
