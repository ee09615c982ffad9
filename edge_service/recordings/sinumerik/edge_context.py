"""Names of axes, tool and NC block beside the samples of an Industrial Edge recording.

As CSV such a recording is three files: `..._hfdata.csv` with columns `NAME|axis`, beside it
`..._header.csv` (`SignalName,Type,Axis,Address`) and `..._hfblockevent.csv`. An event says from
which count on a block is worked off: `HFBlockEvent` with `HFProbeCounter`, the count of `CYCLE`,
`ActiveTool`, `SeekOffset` (place in the program) and `GCode` (text of the block).
Layout: CaptureDataParser of max-scw, and the files of Stroebel et al., "A Multimodal Dataset for
Process Monitoring and Anomaly Detection in Industrial CNC Milling" (KIT, 2025).
"""

import csv
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
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
_MOST_AXES = 1000
_LONGEST_HEADER = 1 << 20


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


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


@dataclass(slots=True)
class EdgeContext:
    """Context beside the samples.

    Attributes:
        period_s: of the count; None where nothing says it.
        axis_names: number of an axis -> its name.
        events: tool and block; they may still come while the samples are read.
        has_events: whether there may be some.
        remarks: one line each.
    """

    period_s: float | None = None
    axis_names: dict[int, str] = field(default_factory=dict)
    events: BlockEvents = field(default_factory=BlockEvents)
    has_events: bool = False
    remarks: list[str] = field(default_factory=list)

    def name_axis(self, address: str, name: str) -> None:
        """Note the name of the axis that a signal belongs to."""
        number = address.rpartition("|")[2]
        if name.strip() and number.isdecimal() and len(self.axis_names) < _MOST_AXES:
            self.axis_names.setdefault(int(number), name.strip()[:20])


def context_beside(path: Path) -> EdgeContext:
    """Content of the files beside a `hfdata.csv`; what cannot be read is a remark."""
    context = EdgeContext()
    place = path.name.lower().rfind("hfdata")
    for kind, read in (("header", _read_header), ("hfblockevent", _read_events)):
        beside = path.with_name(path.name[:place] + kind + path.name[place + len("hfdata") :])
        if place < 0 or not beside.is_file():
            continue
        try:
            read(context, beside)
        except (OSError, ValueError, csv.Error) as error:
            context.remarks.append(f"{beside.name}: not used ({' '.join(str(error).split())[:80]})")
    return context


def _read_header(context: EdgeContext, path: Path) -> None:
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = file.read(_LONGEST_HEADER).splitlines()
    for row in csv.DictReader(lines):
        context.name_axis(row.get("Address") or "", row.get("Axis") or "")


def _read_events(context: EdgeContext, path: Path) -> None:
    if path.stat().st_size > _LARGEST_FILE:
        raise ValueError(f"more than {_LARGEST_FILE >> 20} MB")
    events = BlockEvents()
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        first = file.readline(_LONGEST_HEADER)
        delimiter = ";" if ";" in first.split(GCODE)[0] else ","
        file.seek(0)
        reader = csv.DictReader(file, delimiter=delimiter)
        if not set(_COUNTERS) & set(reader.fieldnames or ()):
            raise ValueError(f"no column {_COUNTERS[0]}")
        for row in reader:
            events.add(row)
    context.events, context.has_events = events, True
    context.remarks.append(f"{path.name}: {events.count} blocks of the NC program")
