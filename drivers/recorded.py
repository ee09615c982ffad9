"""Reading of recordings in a thread, block by block."""

from pathlib import Path

import numpy as np

from edge_service.messages.edge_block import LONGEST_S
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import TraceReader, open_trace
from edge_service.recordings.sinumerik.signals import ControllerAxis
from edge_service.threads import Threads


class RecordedRows:
    """An axis' recordings, one at a time. One thread opens, reads and closes in turn."""

    def __init__(self, name: str, machine: Machine) -> None:
        self.reader: TraceReader | None = None
        self._columns = machine.columns
        self._axis = ControllerAxis(machine.axis.number, machine.axis.lead_m)
        self._turn = 0  # grows with each close: an open that was given up before comes too late
        self.run = Threads(name).run

    async def open(self, path: Path) -> TraceReader | None:
        """Open a recording; None if it was closed meanwhile. Raises TraceError."""
        turn = self._turn

        def opened() -> TraceReader | None:
            if self._turn == turn:
                self.reader = self.open_now(path)
            return self.reader

        return await self.run(opened)

    def is_open(self) -> bool:
        return self.reader is not None

    def open_now(self, path: Path) -> TraceReader:
        """A reader of a recording, for a thread of its own. Raises TraceError."""
        return open_trace(path, self._columns, self._axis)

    async def next(self, reader: TraceReader) -> SampleFrame | None:
        """The next rows; None at the end, or once it is closed. Raises TraceError."""
        frame = await self.run(lambda: next(reader, None) if self.reader is reader else None)
        if frame is not None and (latest_s := float(np.abs(frame.time_s).max())) > LONGEST_S:
            raise TraceError(f"{reader.path}: no clock shows {latest_s:.3g} s; is it in seconds?")
        return frame

    async def close(self) -> None:
        self._turn += 1
        reader, self.reader = self.reader, None

        def closed() -> None:
            for each in (reader, self.reader):
                if each is not None:
                    each.close()
            self.reader = None  # one that was being opened meanwhile

        await self.run(closed)
