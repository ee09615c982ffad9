"""Rows of a fleet: one per axis, each against its peers, the worst first. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from operator import attrgetter
from typing import Any

from ...messages.health import AxisCondition
from ..trend.fleet_rates import PeerVerdict, WearRate, against_peers

WORST_FIRST = (
    AxisCondition.FAULT,
    AxisCondition.WARNING,
    AxisCondition.UNAVAILABLE,
    AxisCondition.NORMAL,
)
_SIGMAS_AT_90 = 1.645


@dataclass(frozen=True, slots=True)
class FleetRow:
    """One axis, or one service that cannot be asked (then `axis` is empty).

    Attributes:
        preload_percent, low, high: percent of the load rating; None where there is no number.
        share_percent: of the fresh preload.
        age_s: of the newest sample behind the estimate.
        fits: whether the model fits; None if nobody can tell.
        limit, limit_earliest, limit_latest: the next limit that will be reached, RFC 3339.
        loss_percent_per_1000_h: of the fresh preload, with the bounds of its 90 % interval.
        peers: against the other axes of the fleet.
        reason: why, in one sentence.
        headline, task: what the axis says, and the most urgent thing to do; empty if there is none.
        version: of the edge-service that says so; empty if unknown.
    """

    address: str
    site: str
    machine: str
    axis: str
    condition: AxisCondition
    preload_percent: float | None = None
    low: float | None = None
    high: float | None = None
    share_percent: float | None = None
    age_s: float | None = None
    fits: bool | None = None
    limit: str | None = None
    limit_earliest: str | None = None
    limit_latest: str | None = None
    loss_percent_per_1000_h: tuple[float, float, float] | None = None
    peers: PeerVerdict | None = None
    reason: str = ""
    headline: str = ""
    task: str = ""
    version: str = ""


_NAMES = [field.name for field in fields(FleetRow)]
_ROW: Any = FleetRow
_PEERS = _NAMES.index("peers")
_BEFORE, _AFTER = attrgetter(*_NAMES[:_PEERS]), attrgetter(*_NAMES[_PEERS + 1 :])


def compared(rows: Sequence[FleetRow]) -> list[FleetRow]:
    """The same rows, each axis with a rate against the others, the worst first."""
    known = [row for row in rows if row.loss_percent_per_1000_h is not None]
    verdicts = against_peers([_rate(row) for row in known])
    of = dict(zip(map(id, known), verdicts, strict=True))
    judged = [_judged(row, of.get(id(row))) for row in rows]
    return sorted(judged, key=_gravity)


def _judged(row: FleetRow, verdict: PeerVerdict | None) -> FleetRow:
    """The row with a verdict; `replace` would take ten times as long for thousands of axes."""
    made: FleetRow = _ROW(*_BEFORE(row), verdict, *_AFTER(row))
    return made


def _rate(row: FleetRow) -> WearRate:
    assert row.loss_percent_per_1000_h is not None
    loss, low, high = row.loss_percent_per_1000_h
    return WearRate(loss, (high - low) / (2.0 * _SIGMAS_AT_90))


def _gravity(row: FleetRow) -> tuple[int, bool, str, str, str]:
    faster = row.peers is not None and row.peers.faster
    return WORST_FIRST.index(row.condition), not faster, row.site, row.machine, row.axis


def worst(rows: Sequence[FleetRow]) -> AxisCondition:
    """Condition of the whole fleet."""
    present = {row.condition for row in rows}
    return next(each for each in WORST_FIRST if each in present)
