"""An axis sent to a broker as the capture of Industrial Edge sends it: 500 Hz, in blocks."""

import asyncio
import json
from collections.abc import Sequence
from contextlib import aclosing, suppress
from typing import Any

import numpy as np

from edge_service.messages.samples import Floats, SampleFrame
from edge_service.recordings.sinumerik.edge import HEADER, PAYLOAD, PERIOD_S, SAMPLES
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
STEPS, HOLE = 5, 1.5
"""First steps that tell the source's own, and how many times as long a hole is at least."""
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
                raise DriverMisconfiguredError(
                    "topic", f"{config.topic!r}: the stub needs one topic for each axis"
                )
            topics.add(config.topic)
        self.fault = Fault()
        self._axes = axes
        self._senders: list[asyncio.Task[None]] = []
        self._links: list[MqttLink] = []

    async def start(self) -> str:
        """Reach the broker; returns its address. Raises DriverMisconfiguredError."""
        try:
            for axis in self._axes:
                self._links.append(await _reached(axis.config))
        except DriverUnavailableError as error:
            await self.close()
            raise DriverMisconfiguredError("url", f"no broker: {error}") from None
        links = zip(self._axes, self._links, strict=True)
        self._senders = [asyncio.create_task(self._send(*each)) for each in links]
        return ", ".join(str(axis.config.address) for axis in self._axes)

    async def close(self) -> None:
        """Leave; safe twice."""
        senders, self._senders = self._senders, []
        for sender in senders:
            sender.cancel()
        await asyncio.gather(*senders, return_exceptions=True)
        links, self._links = self._links, []
        for link in links:
            await link.close()

    async def _send(self, axis: StubAxis, link: MqttLink) -> None:
        """Send an axis' samples, and what is left of a block at the source's end."""
        writer, number = EdgeWriter(axis), 0
        try:
            async with aclosing(axis.source) as frames:
                async for frame in frames:
                    for block in writer.blocks(frame):
                        number += 1
                        link = await self._publish(axis, link, writer, block, number)
            for block in writer.rest():
                link = await self._publish(axis, link, writer, block, number + 1)
        finally:
            await link.close()

    async def _publish(
        self, axis: StubAxis, link: MqttLink, writer: "EdgeWriter", block: Floats, number: int
    ) -> MqttLink:
        """Send a block as the fault wants it, or lose it as a capture does; the link that is left.

        Args:
            number: of the block, from 1.
        """
        fault = self.fault.kind
        payload = writer.message(block, numbers=fault is not FaultKind.EXCEPTION)
        times = {FaultKind.STALE: 2, FaultKind.HANG: 0, FaultKind.DROP: number % 2}.get(fault, 1)
        if fault is FaultKind.DELAY:
            await asyncio.sleep(self.fault.amount)
        try:
            for _ in range(times):
                await link.publish(axis.config.topic, payload)
        except DriverUnavailableError:
            await link.close()
            await asyncio.sleep(AGAIN_S)
            with suppress(DriverUnavailableError):
                return await _reached(axis.config)
        return link


class EdgeWriter:
    """Samples of an axis as messages of the capture, in the units of the control."""

    def __init__(self, axis: StubAxis) -> None:
        machine = axis.context.machine
        number = machine.axis.number or 1
        controller = ControllerAxis(number, machine.axis.lead_m)
        self._factors: dict[str, float] = {}
        signals = [{"Name": EDGE_CYCLE, "Type": "INT", "Axis": "", "Address": EDGE_CYCLE}]
        for channel, (short, *_) in EDGE_SIGNALS.items():
            factor = controller.scale(channel, EDGE_UNITS[short])
            if factor is not None:
                name = f"{short}|{number}"
                self._factors[channel] = factor
                signals.append({"Name": name, "Type": "DOUBLE", "Axis": "", "Address": name})
        self._header = {"SignalListHFData": signals, "CycleTimeMs": 1e3 * PERIOD_S}
        self._rows: list[list[float]] = []
        self._last = np.empty((0, 1 + len(self._factors)))
        self._steps_s: list[float] = []

    def blocks(self, frame: SampleFrame) -> list[Floats]:
        """Blocks that have become whole.

        The capture counts instants: between the samples of another rate it is interpolated, over
        a hole there is nothing.
        """
        missing = np.full(len(frame), np.nan)
        columns = [frame.channels.get(name, missing) / each for name, each in self._factors.items()]
        rows = np.vstack([self._last, np.column_stack([frame.time_s, *columns])])
        latest = np.maximum.accumulate(rows[:, 0])
        rows = rows[np.append(True, rows[1:, 0] > latest[:-1])] if len(rows) else rows
        found = []
        self._steps_s = (self._steps_s + np.diff(rows[:, 0]).tolist())[:STEPS]
        most_s = HOLE * float(np.median(self._steps_s or [0.0]))
        for row in _at_counts(rows, most_s, first=len(self._last) == 0):
            self._rows.append(row)
            if len(self._rows) == BLOCK_ROWS:
                found += self.rest()
        self._last = rows[-1:]
        return found

    def rest(self) -> list[Floats]:
        """The block that is not whole yet, if there is one."""
        rows, self._rows = self._rows, []
        return [np.array(rows)] if rows else []

    def message(self, block: Floats, *, numbers: bool) -> bytes:
        """JSON of a block; without numbers its values are `null`."""
        rows: list[list[Any]] = [
            [int(row[0]), *((each if numbers and np.isfinite(each) else None) for each in row[1:])]
            for row in block.tolist()
        ]
        return json.dumps({HEADER: self._header, PAYLOAD: [{SAMPLES: rows}]}).encode()


def _at_counts(rows: Floats, most_s: float, *, first: bool) -> list[list[float]]:
    """Rows [time in s, values] at the instants of the capture, each with its count for the time.

    Args:
        most_s: over a longer step there is nothing in between.
        first: whether the first row was not there before.
    """
    if not len(rows):
        return []
    at = np.round(rows[:, 0] / PERIOD_S, 6)
    counts = np.arange(np.ceil(at[0]), np.floor(at[-1]) + 1.0)
    counts = counts if first else counts[counts > at[0]]
    after = np.searchsorted(at, counts)
    before = np.maximum(after - (at[after] > counts), 0)
    near = rows[after, 0] - rows[before, 0] <= most_s
    counts, after = counts[near], after[near]
    on_row = at[after] == counts  # beside a missing value there may be one
    values = [
        np.where(on_row, column[after], np.interp(counts, at, column)) for column in rows[:, 1:].T
    ]
    found: list[list[float]] = np.column_stack([FIRST_COUNT + counts, *values]).tolist()
    return found


async def _reached(config: MqttSourceConfig) -> MqttLink:
    link = MqttLink(config, None, keep_session=False)
    try:
        await link.connect()
    except BaseException:
        await link.close()
        raise
    return link
