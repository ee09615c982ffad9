"""Tool and block of the NC program behind each sample of an Industrial Edge recording.

An event says from which count on a block is worked off: `HFBlockEvent` with `HFProbeCounter`, the
count of `CYCLE`, `ActiveTool`, `SeekOffset` (place in the program) and `GCode` (text of the block).
Layout: CaptureDataParser of max-scw, and the files of Stroebel et al., "A Multimodal Dataset for
Process Monitoring and Anomaly Detection in Industrial CNC Milling" (KIT, 2025).
"""

import csv
import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...messages.samples import Floats

PREFIX = "HFBlockEvent."
NUMBERS = ("ActiveTool", "SelectedTool", "SeekOffset")
GCODE = "GCode"
MOST_EVENTS = 2_000_000
_COUNTERS = ("HFProbeCounter", "HfProbeCounter")
_LARGEST_FILE = 1 << 28


class BlockEvents:
    """Events in the order of the recording; a count that falls begins the next run."""

    names = tuple(PREFIX + name for name in (*NUMBERS, GCODE))

    def __init__(self) -> None:
        self.count = 0
        self._runs: list[tuple[list[float], list[list[float]]]] = [([], [])]

    def add(self, event: Mapping[str, Any]) -> None:
        """Keep an event; one without a count says nothing."""
        counter = next((_number(event[name]) for name in _COUNTERS if name in event), math.nan)
        if not math.isfinite(counter) or self.count >= MOST_EVENTS:
            return
        counters = self._runs[-1][0]
        if counters and counter < counters[-1]:
            self._runs.append(([], []))
        block = str(event.get(GCODE) or "").strip()
        numbers = [_number(event.get(name)) for name in NUMBERS]
        self._runs[-1][0].append(counter)
        self._runs[-1][1].append([*numbers, block_number(block) if block else math.nan])
        self.count += 1

    def at(self, cycle: Floats, run: Floats) -> dict[str, Floats]:
        """Columns of the events in force; NaN before the first, shape (n,) each.

        Args:
            cycle: count of each sample, (n,).
            run: how often the count has begun anew before it, (n,).
        """
        values = np.full((len(cycle), len(self.names)), np.nan)
        for number in np.unique(run).astype(int):
            counters, found = self._runs[min(number, len(self._runs) - 1)]
            newest = np.searchsorted(counters, cycle, side="right") - 1
            here = (run == number) & (newest >= 0) & np.isfinite(cycle)
            if here.any():
                values[here] = np.array(found)[newest[here]]
        return dict(zip(self.names, values.T, strict=True))


def block_number(block: str) -> float:
    """A number that equal blocks share, whatever the day: CRC-32 of the text.

    >>> block_number("G1 X10") == block_number("G1 X10") != block_number("G1 X11")
    True
    """
    return float(zlib.crc32(block.encode()))


def read_block_events(path: Path) -> BlockEvents:
    """Events of a `hfblockevent.csv`. Raises OSError, and ValueError for what is none."""
    if path.stat().st_size > _LARGEST_FILE:
        raise ValueError(f"more than {_LARGEST_FILE >> 20} MB")
    events = BlockEvents()
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        delimiter = ";" if ";" in file.readline().split(GCODE)[0] else ","
        file.seek(0)
        reader = csv.DictReader(file, delimiter=delimiter)
        if not set(_COUNTERS) & set(reader.fieldnames or ()):
            raise ValueError(f"no column {_COUNTERS[0]}")
        try:
            for row in reader:
                events.add(row)
        except csv.Error as error:
            raise ValueError(str(error)) from None
    return events


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan
