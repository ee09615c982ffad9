"""Answers of many services as one row per axis, the worst first."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

from ...health.axis_report import fits, loss_per_1000_h, sentence
from ...health.trend.fleet_rates import PeerVerdict, WearRate, against_peers
from ...messages.estimate import Interval
from ...messages.health import AxisCondition

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


class StrangeAnswerError(ValueError):
    """A service answered something that is no answer of an edge-service."""


def unreachable(address: str, name: str, reason: str) -> FleetRow:
    """A service that nothing is known of."""
    condition = AxisCondition.UNAVAILABLE
    return FleetRow(address, name or "?", "?", "", condition, reason=reason)


def rows_of(
    address: str,
    axes: Mapping[str, Any],
    health: Mapping[str, Any],
    preloads: Sequence[Mapping[str, Any]],
) -> list[FleetRow]:
    """Rows of one service from its answers, tolerant of members that are missing or new.

    Raises StrangeAnswerError.
    """
    try:
        by_axis = {each["axis"]: each for each in health["axes"]}
        limits = {each["axis"]: each.get("limits") for each in axes["axes"]}
        site, machine = str(axes.get("site", "?")), str(axes.get("machine", "?"))
        return [
            _row(
                FleetRow(address, site, machine, each["axis"], _condition(each)), each, more, fresh
            )
            for each in preloads
            for more, fresh in [(by_axis[each["axis"]], _fresh(limits[each["axis"]]))]
        ]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise StrangeAnswerError(f"no answer of an edge-service ({error!r})") from None


def _condition(answer: Mapping[str, Any]) -> AxisCondition:
    return AxisCondition(answer["condition"])


def _fresh(limits: Mapping[str, float] | None) -> float | None:
    return None if limits is None else float(limits["fresh_percent"])


def _row(
    row: FleetRow, preload: Mapping[str, Any], health: Mapping[str, Any], fresh: float | None
) -> FleetRow:
    percent, trend = preload["preload_percent"], health.get("trend")
    limit, earliest, latest = _next_limit(trend)
    reasons = preload["reasons"] or health["reasons"]
    return replace(
        row,
        preload_percent=percent,
        low=preload["low"],
        high=preload["high"],
        share_percent=None if percent is None or fresh is None else 100.0 * percent / fresh,
        age_s=preload["age_s"],
        fits=fits(preload["status"], doubted=_doubted(health)),
        limit=limit,
        limit_earliest=earliest,
        limit_latest=latest,
        loss_percent_per_1000_h=_loss(trend, fresh),
        reason=sentence([str(each) for each in reasons]),
        headline=str((health.get("headline") or {}).get("text", "")),
        task=str((health.get("advice") or [{}])[0].get("text", "")),
    )


def _doubted(health: Mapping[str, Any]) -> bool:
    return any(each["alarm"] == "model" and each["active"] for each in health["alarms"])


def _next_limit(trend: Mapping[str, Any] | None) -> tuple[str | None, str | None, str | None]:
    for crossing in (trend or {}).get("crossings", []):
        if crossing["earliest"] is not None:
            return crossing["limit"], crossing["earliest"], crossing["latest"]
    return None, None, None


def _loss(
    trend: Mapping[str, Any] | None, fresh: float | None
) -> tuple[float, float, float] | None:
    rate = (trend or {}).get("rate_percent_per_h")
    if rate is None or not fresh:
        return None
    known = Interval(value=rate["value"], low=rate["low"], high=rate["high"])
    loss = loss_per_1000_h(known, fresh)
    return loss.value, loss.low, loss.high


def compared(rows: Sequence[FleetRow]) -> list[FleetRow]:
    """The same rows, each axis with a rate against the others, the worst first."""
    known = [row for row in rows if row.loss_percent_per_1000_h is not None]
    verdicts = against_peers([_rate(row) for row in known])
    of = dict(zip(map(id, known), verdicts, strict=True))
    ordered = [replace(row, peers=of.get(id(row))) for row in rows]
    return sorted(ordered, key=_gravity)


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


def days_until(moment: str, now: datetime | None = None) -> float:
    """Days from now until an RFC 3339 time."""
    return (datetime.fromisoformat(moment) - (now or datetime.now(UTC))).total_seconds() / 86400.0
