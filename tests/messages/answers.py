"""Answers about an axis, as outputs get them."""

from typing import Any

from edge_service.health.statements import consistent
from edge_service.messages.answer import AxisAnswer
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import Alarm, AlarmKind, AxisHealth, Limits

MEASURED_NS = 1_790_000_000_000_000_000
LIMITS = Limits(fresh_percent=6.85, warning_percent=4.11, fault_percent=2.055)


def health_of(condition: AxisCondition, **changes: Any) -> AxisHealth:
    facts: dict[str, Any] = {"since_time_ns": MEASURED_NS, "limits": LIMITS} | changes
    return consistent(AxisHealth(axis="X", condition=condition, **facts), None)


def alarm_of(kind: AlarmKind, **facts: Any) -> Alarm:
    known = {"level": AxisCondition.FAULT, "active": True, "text": "gone", "raised_time_ns": 1}
    return Alarm.model_validate({"kind": kind} | known | facts)


def answer(
    axis: str = "X",
    *,
    estimate: PreloadEstimate | None = None,
    health: AxisHealth | None = None,
    is_heard: bool = True,
    measured_ns: int | None = MEASURED_NS,
    limits: Limits | None = LIMITS,
    **numbers: float,
) -> AxisAnswer:
    known = {"preload_percent": 6.7, "low": 6.5, "high": 6.9} | numbers
    good = PreloadEstimate(time_s=1.0, status=EstimateStatus.ESTIMATED, **known)
    return AxisAnswer(
        axis=axis,
        estimate=estimate or good,
        measured_ns=measured_ns,
        health=health or health_of(AxisCondition.NORMAL, limits=limits),
        is_heard=is_heard,
    )


SILENT = answer(
    estimate=PreloadEstimate(time_s=0.0, status=EstimateStatus.UNESTIMATED),
    health=health_of(AxisCondition.UNAVAILABLE, reasons=("no_health: not heard yet",)),
    is_heard=False,
    measured_ns=None,
)
"""Answer of a service that hears nothing."""
