"""Context beside the samples of an Industrial Edge recording.

As CSV such a recording is three files: `..._hfdata.csv` with columns `NAME|axis`, beside it
`..._header.csv` (`SignalName,Type,Axis,Address`) and `..._hfblockevent.csv`.
"""

import csv
from dataclasses import dataclass, field
from pathlib import Path

from .block_events import BlockEvents, read_block_events

_DATA, _HEADER, _EVENTS = "hfdata", "header", "hfblockevent"
_MOST_AXES = 1000
_LONGEST_HEADER = 1 << 20


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
    for kind, read in ((_HEADER, _read_header), (_EVENTS, _read_events)):
        beside = _beside(path, kind)
        if beside is None:
            continue
        try:
            read(context, beside)
        except (OSError, ValueError, csv.Error) as error:
            context.remarks.append(f"{beside.name}: not used ({' '.join(str(error).split())[:80]})")
    return context


def _beside(path: Path, kind: str) -> Path | None:
    """The file of a kind that belongs to a recording: the same name with another ending."""
    stem = path.name
    place = stem.lower().rfind(_DATA)
    if place < 0:
        return None
    beside = path.with_name(stem[:place] + kind + stem[place + len(_DATA) :])
    return beside if beside.is_file() else None


def _read_header(context: EdgeContext, path: Path) -> None:
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        lines = file.read(_LONGEST_HEADER).splitlines()
    for row in csv.DictReader(lines):
        context.name_axis(row.get("Address") or "", row.get("Axis") or "")


def _read_events(context: EdgeContext, path: Path) -> None:
    context.events, context.has_events = read_block_events(path), True
    context.remarks.append(f"{path.name}: {context.events.count} blocks of the NC program")
