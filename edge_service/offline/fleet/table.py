"""The table of a fleet for people."""

from collections.abc import Sequence
from datetime import datetime

from rich.console import Group
from rich.table import Table
from rich.text import Text

from ...health.fleet.rows import WORST_FIRST, FleetRow, worst
from ...messages.health import AxisCondition
from ...messages.printed import printed
from ..document import Document
from .rows import days_until

_HEAD = (
    "SITE",
    "MACHINE",
    "AXIS",
    "CONDITION",
    "PRELOAD % (95 %)",
    "OF FRESH",
    "AGE",
    "FITS",
    "NEXT LIMIT",
    "LOSS %/1000 H (90 %)",
    "WHY",
    "HEADLINE",
    "TO DO",
)
_ON_TERMINAL = ("SITE", "MACHINE", "AXIS", "CONDITION", "OF FRESH", "NEXT LIMIT")
_STYLES = {
    AxisCondition.FAULT: "bold red",
    AxisCondition.WARNING: "yellow",
    AxisCondition.UNAVAILABLE: "dim",
    AxisCondition.NORMAL: "green",
}
_FITS = {True: "yes", False: "NO", None: "-"}


def table_of(rows: Sequence[FleetRow], now: datetime | None = None) -> str:
    """A line on the whole fleet, then one line per axis or silent service."""
    cells = [_HEAD, *(_cells(row, now) for row in rows)]
    widths = [max(len(line[k]) for line in cells) for k in range(len(_HEAD))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in cells
    ]
    return "\n".join([_summary(rows), *lines, *_faster(rows)])


def terminal_table(rows: Sequence[FleetRow], now: datetime | None = None) -> Group:
    """The same for a terminal, in colour and as wide as that is, with what matters most."""
    table = Table(*_ON_TERMINAL, "HEADLINE", "TO DO")
    for row in rows:
        cells = dict(zip(_HEAD, _cells(row, now), strict=True))
        headline = row.headline or _why(row)
        shown = [*(cells[name] for name in _ON_TERMINAL), headline, row.task or "-"]
        table.add_row(*map(Text, shown), style=_STYLES[row.condition])
    return Group(_summary(rows), table, *map(Text, _faster(rows)))


class Fleet(Document):
    """The same for programs: the condition of the whole, and its rows."""

    condition: AxisCondition
    rows: list[FleetRow]

    @classmethod
    def of(cls, rows: Sequence[FleetRow]) -> "Fleet":
        """The document of rows."""
        return cls(condition=worst(rows), rows=list(rows))


def _summary(rows: Sequence[FleetRow]) -> str:
    if not rows:
        return "FLEET: no axis is known"
    counts = [(each, sum(row.condition is each for row in rows)) for each in WORST_FIRST]
    summed = ", ".join(f"{count} {condition}" for condition, count in counts if count)
    return f"FLEET {worst(rows)}: {summed}"


def _cells(row: FleetRow, now: datetime | None) -> tuple[str, ...]:
    return (
        row.site,
        row.machine,
        row.axis or "-",
        str(row.condition),
        _preload(row),
        "-" if row.share_percent is None else f"{row.share_percent:.0f} %",
        "-" if row.age_s is None else _lasting(row.age_s),
        _FITS[row.fits],
        _limit(row, now),
        _loss(row),
        _why(row),
        row.headline or "-",
        row.task or "-",
    )


def _why(row: FleetRow) -> str:
    why = row.reason
    if row.peers is not None and row.peers.faster:
        why = f"wears faster than its peers; {why}".removesuffix("; ")
    return why if row.axis else f"{row.address}: {why}"


def _preload(row: FleetRow) -> str:
    if row.preload_percent is None:
        return "-"
    if row.low is None or row.high is None:
        return f"{row.preload_percent:.2f}"
    value, low, high = printed(row.preload_percent, row.low, row.high, 2)
    return f"{value} ({low} to {high})"


def _limit(row: FleetRow, now: datetime | None) -> str:
    if row.limit is None or row.limit_earliest is None:
        return "no date"
    if row.limit_latest is None:
        return f"{row.limit} not before {_moment(row.limit_earliest, now)}"
    return f"{row.limit} {_moment(row.limit_earliest, now)} to {_moment(row.limit_latest, now)}"


def _moment(moment: str, now: datetime | None) -> str:
    """A date, or a time in UTC where it is near."""
    return f"{moment[11:16]}Z" if days_until(moment, now) < 1.0 else moment[:10]


def _loss(row: FleetRow) -> str:
    if row.loss_percent_per_1000_h is None:
        return "-"
    value, low, high = row.loss_percent_per_1000_h
    return f"{_digits(value)} ({_digits(low)} to {_digits(high)})"


def _digits(value: float) -> str:
    """Three digits, without powers of ten."""
    return f"{value:,.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def _lasting(seconds: float) -> str:
    for below, size, unit in ((100.0, 1.0, "s"), (6000.0, 60.0, "min"), (2e5, 3600.0, "h")):
        if seconds < below:
            return f"{seconds / size:.0f} {unit}" if seconds >= 1.0 else "<1 s"
    return f"{seconds / 86400.0:.0f} days"


def _faster(rows: Sequence[FleetRow]) -> list[str]:
    """A sentence on each axis that wears faster than its peers."""
    lines = []
    for row in rows:
        if row.peers is not None and row.peers.faster and row.loss_percent_per_1000_h is not None:
            lines.append(
                f"{row.site}/{row.machine}/{row.axis} loses "
                f"{_digits(row.loss_percent_per_1000_h[0])} % of its fresh preload per 1000 h, its "
                f"{row.peers.peers} peers {_digits(row.peers.peers_loss)} %: with probability "
                f"{row.peers.probability:.3f} more than its kind"
            )
    return lines
