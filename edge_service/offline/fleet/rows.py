"""Answers of many services as one row per axis."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from ...health.axis_report import fits, loss_per_1000_h, sentence
from ...health.fleet.rows import FleetRow
from ...messages.estimate import Interval
from ...messages.health import AxisCondition


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


def days_until(moment: str, now: datetime | None = None) -> float:
    """Days from now until an RFC 3339 time."""
    return (datetime.fromisoformat(moment) - (now or datetime.now(UTC))).total_seconds() / 86400.0
