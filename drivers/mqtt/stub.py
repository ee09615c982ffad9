"""An axis sent to a broker as the capture of Industrial Edge sends it: in blocks, with a count."""

import asyncio
import json
from collections.abc import Sequence
from contextlib import aclosing, suppress
from typing import Any

import numpy as np

from edge_service.messages.samples import SampleFrame
from edge_service.recordings.sinumerik.edge import HEADER, PAYLOAD, SAMPLES
from edge_service.recordings.sinumerik.signals import (
    EDGE_CYCLE,
    EDGE_SIGNALS,
    EDGE_UNITS,
    ControllerAxis,
)

from ..base import DriverMisconfiguredError, DriverUnavailableError
from ..stub import Fault, FaultKind, StubAxis
from .link import MqttLink, MqttSourceConfig

BLOCK_ROWS = 25
FIRST_COUNT = 5000
AGAIN_S = 0.2
"""Between two tries to reach the broker."""


class MqttStub:
    """A client for each axis. A broker must be there.

    Faults: `delay`; `exception` sends no numbers; `stale` sends each block twice; `drop` leaves
    out every second block; `hang` sends nothing.
    """

    def __init__(self, axes: Sequence[StubAxis]) -> None:
        topics: set[str] = set()
        for axis in axes:
            config: MqttSourceConfig = axis.config
            if config.signals:
                raise DriverMisconfiguredError("signals", "the stub sends the capture's form alone")
            if {"+", "#"} & set(config.topic.split("/")) or config.topic in topics:
                words = f"{config.topic!r}: the stub needs one topic for each axis"
                raise DriverMisconfiguredError("topic", words)
            topics.add(config.topic)
        self.fault = Fault()
        self._axes = axes
        self._senders: list[asyncio.Task[None]] = []
        self._links = {axis.name: MqttLink(axis.config, None) for axis in axes}

    async def start(self) -> str:
        """Reach the broker; returns its address. Raises DriverMisconfiguredError."""
        try:
            for link in self._links.values():
                await link.connect()
        except DriverUnavailableError as error:
            await self.close()
            raise DriverMisconfiguredError("url", f"no broker: {error}") from None
        self._senders = [asyncio.create_task(self._send(axis)) for axis in self._axes]
        return ", ".join(str(axis.config.address) for axis in self._axes)

    async def close(self) -> None:
        senders, self._senders = self._senders, []
        for sender in senders:
            sender.cancel()
        await asyncio.gather(*senders, return_exceptions=True)
        for link in self._links.values():
            await link.close()

    async def _send(self, axis: StubAxis) -> None:
        """Send an axis' samples, and what is left of a block at the source's end."""
        writer = EdgeWriter(axis)
        async with aclosing(axis.source) as frames:
            async for frame in frames:
                writer.add(frame)
                while len(writer.rows) >= BLOCK_ROWS:
                    await self._publish(axis, writer)
        if len(writer.rows) > 1:
            await self._publish(axis, writer)

    async def _publish(self, axis: StubAxis, writer: "EdgeWriter") -> None:
        """Send a block as the fault wants it, or lose it as a capture does."""
        fault = self.fault.kind
        payload = writer.message(numbers=fault is not FaultKind.EXCEPTION)
        times = {FaultKind.STALE: 2, FaultKind.HANG: 0, FaultKind.DROP: writer.blocks % 2}
        if fault is FaultKind.DELAY:
            await asyncio.sleep(self.fault.amount)
        link = self._links[axis.name]
        try:
            for _ in range(times.get(fault, 1)):
                await link.publish(axis.config.topic, payload)
        except DriverUnavailableError:
            await link.close()
            await asyncio.sleep(AGAIN_S)
            link = self._links[axis.name] = MqttLink(axis.config, None)
            with suppress(DriverUnavailableError):
                await link.connect()


class EdgeWriter:
    """Samples of an axis as messages of the capture, in the units of the control.

    Attributes:
        rows: not sent yet, [time in s, values].
        blocks: sent so far.
    """

    def __init__(self, axis: StubAxis) -> None:
        machine = axis.context.machine
        number = machine.axis.number or 1
        controller = ControllerAxis(number, machine.axis.lead_m)
        self._factors: dict[str, float] = {}
        names = [EDGE_CYCLE]
        for channel, (short, *_) in EDGE_SIGNALS.items():
            factor = controller.scale(channel, EDGE_UNITS[short])
            if factor is not None:
                self._factors[channel] = factor
                names.append(f"{short}|{number}")
        self._signals = [{"Name": name, "Axis": "", "Address": name} for name in names]
        self._period_s: float | None = None
        self.rows: list[list[float]] = []
        self.blocks = 0

    def add(self, frame: SampleFrame) -> None:
        """Take in samples."""
        missing = np.full(len(frame), np.nan)
        columns = [frame.channels.get(name, missing) / each for name, each in self._factors.items()]
        self.rows += np.column_stack([frame.time_s, *columns]).tolist()

    def message(self, *, numbers: bool) -> bytes:
        """JSON of the next block; without numbers its values are `null`."""
        block, self.rows = np.array(self.rows[:BLOCK_ROWS]), self.rows[BLOCK_ROWS:]
        self.blocks += 1
        if self._period_s is None:
            self._period_s = round(float(np.median(np.diff(block[:, 0]))), 6)
        rows: list[list[Any]] = [
            [
                FIRST_COUNT + round(time_s / self._period_s),
                *(each if numbers and np.isfinite(each) else None for each in values),
            ]
            for time_s, *values in block.tolist()
        ]
        header = {"SignalListHFData": self._signals, "CycleTimeMs": 1e3 * self._period_s}
        return json.dumps({HEADER: header, PAYLOAD: [{SAMPLES: rows}]}).encode()
