"""A recording played back as if the axis were there."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable
from contextlib import aclosing
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from edge_service.messages.samples import SampleFrame
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import TraceReader

from .base import (
    QUIET_S,
    DriverConfig,
    DriverContext,
    DriverMisconfiguredError,
    DriverUnavailableError,
    Probe,
)
from .recorded import RecordedRows
from .rows import FRAME_S, FrameCutter, Pace

FLAT_OUT_FRAME_S = 0.5
"""Axis time per frame, where it is played as fast as possible."""
LONGEST_STEP_S = 2.0
"""A jump of the recorded clock is waited for no longer than this, in axis time."""


class ReplayConfig(DriverConfig):
    """Settings of the replay driver."""

    path: Path  # the trace, CSV or Parquet; the machine file maps its columns
    speed: float = Field(1.0, ge=0.0)  # axis time over real time; 0 is as fast as possible
    loop: bool = False  # start again at the end, for ever


class ReplayDriver:
    """Yields the rows of a trace in their order, each frame when its last sample is due."""

    config_model: ClassVar[type[DriverConfig]] = ReplayConfig

    def __init__(
        self,
        config: ReplayConfig,
        context: DriverContext,
        *,
        clock: Callable[[], float] | None = None,
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self.paced = config.speed > 0.0
        self.quiet_s = QUIET_S + (LONGEST_STEP_S / config.speed if self.paced else 0.0)
        self.frame_s = FRAME_S if self.paced else FLAT_OUT_FRAME_S
        self._config, self._clock, self._sleep = config, clock, sleep
        self.readings: dict[str, float] = {}  # a recording knows no more than its samples
        self._rows = RecordedRows(f"replay {context.axis}", context.machine)
        self._finished = {"rows": 0, "bad_cells": 0, "ragged_rows": 0, "restarts": 0}

    @property
    def counters(self) -> dict[str, int]:
        total, reader = self._finished.copy(), self._rows.reader
        if reader is not None:
            total["rows"] += reader.rows_read
            total["bad_cells"] += sum(reader.bad_cells.values())
            total["ragged_rows"] += reader.ragged_rows
        return total

    async def open(self) -> None:
        """Open the trace and check its columns; raises DriverMisconfiguredError."""
        if self._rows.reader is None:
            try:
                await self._rows.open(self._config.path)
            except TraceError as error:
                raise DriverMisconfiguredError("path", str(error)) from None

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        if not self._rows.is_open():
            raise DriverUnavailableError(f"{self._config.path}: the recording is not open")
        pace: Pace | None = None
        newest_s = 0.0
        async with aclosing(self._cut_frames()) as frames:
            async for frame in frames:
                if pace is None:
                    clock = self._clock or asyncio.get_running_loop().time
                    pace, newest_s = Pace(self._config.speed, clock), float(frame.time_s[0])
                step_s, newest_s = float(frame.time_s[-1]) - newest_s, float(frame.time_s[-1])
                # Even without a wait: the event loop must get its turn between two reads.
                await self._sleep(pace.wait_s(min(max(step_s, 0.0), LONGEST_STEP_S)))
                if not self._rows.is_open():
                    return
                yield frame

    async def probe(self) -> Probe:
        def first_rows() -> tuple[TraceReader, SampleFrame]:
            with self._rows.open_now(self._config.path) as reader:
                return reader, next(reader)

        try:
            reader, first = await self._rows.run(first_rows)
        except TraceError as error:
            raise DriverMisconfiguredError("path", str(error)) from None
        steps_s = np.diff(first.time_s)
        steps_s = steps_s[steps_s > 0.0]
        rate_hz = float(1.0 / np.median(steps_s)) if steps_s.size else None
        return Probe(f"recording {self._config.path.name}", reader.channels, rate_hz)

    async def close(self) -> None:
        self._finished = self.counters
        await self._rows.close()

    async def _cut_frames(self) -> AsyncGenerator[SampleFrame, None]:
        cutter = FrameCutter(self.frame_s)
        async with aclosing(self._blocks()) as blocks:
            async for block in blocks:
                for frame in cutter.cut(block):
                    yield frame
        if cutter.rest is not None:
            yield cutter.rest

    async def _blocks(self) -> AsyncGenerator[SampleFrame, None]:
        """Runs of rows as they are read, for ever in a loop: then their clock begins anew."""
        while (reader := self._rows.reader) is not None:
            try:
                while (block := await self._rows.next(reader)) is not None:
                    yield block
            except TraceError as error:
                raise DriverMisconfiguredError("path", str(error)) from None
            if self._rows.reader is not reader or not self._config.loop:
                return
            await self.close()
            self._finished["restarts"] += 1
            await self.open()
