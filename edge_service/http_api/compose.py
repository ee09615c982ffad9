"""Answers of the JSON routes, composed from the service state."""

from collections.abc import Sequence
from typing import Any

from ..health.history.buckets import Bucket, Spread
from ..health.history.rows import QUANTITIES
from ..health.service_state import ServiceState
from ..health.settings import AxisLimits
from ..messages.alarm import Alarm
from ..messages.event import Event
from ..messages.health import AxisHealth, ComponentHealth, Consistency
from ..messages.trend import Trend
from .answers import (
    AlarmAnswer,
    AxesAnswer,
    AxisAnswer,
    BucketAnswer,
    ComponentAnswer,
    ConsistencyAnswer,
    CrossingAnswer,
    EventAnswer,
    HealthAnswer,
    HistoryAnswer,
    LimitsAnswer,
    PreloadAnswer,
    ServiceAnswer,
    SpreadAnswer,
    TrendAnswer,
)
from .times import rfc3339, rfc3339_s


def preload_answer(state: ServiceState, axis: str, now_ns: int) -> PreloadAnswer:
    """Preload of one axis with its condition."""
    reading = state.preload(axis, now_ns)
    health = state.health(axis, now_ns)
    estimate = reading.estimate
    return PreloadAnswer(
        axis=axis,
        status=estimate.status,
        preload_percent=estimate.preload_percent,
        low=estimate.low,
        high=estimate.high,
        level=estimate.level,
        preload_n=estimate.preload_n,
        drag_torque_nm=estimate.drag_torque_nm,
        stiffness_n_per_m=estimate.stiffness_n_per_m,
        condition=health.condition,
        reasons=_together(health.reasons, estimate.reasons),
        mode_probability=estimate.mode_probability,
        fault_probability=estimate.fault_probability,
        measured_at=None if reading.measured_ns is None else rfc3339(reading.measured_ns),
        age_s=reading.age_s,
    )


def _together(judged: Sequence[str], told: Sequence[str]) -> list[str]:
    """Reasons of both, without those judged of an earlier moment than the same is told of now."""
    codes = {reason.partition(":")[0] for reason in told}
    held = [reason for reason in judged if reason.partition(":")[0] not in codes]
    return list(dict.fromkeys((*held, *told)))


def health_answer(state: ServiceState, axis: str, now_ns: int) -> HealthAnswer:
    """Condition of one axis."""
    return _health(state.health(axis, now_ns))


def service_answer(state: ServiceState, now_ns: int) -> ServiceAnswer:
    """Health of the whole service."""
    reasons = state.unready(now_ns)
    return ServiceAnswer(
        time=rfc3339(now_ns),
        ready=not reasons,
        reasons=list(reasons),
        components=[_component(report) for report in state.components(now_ns)],
        axes=[health_answer(state, axis, now_ns) for axis in state.axes],
    )


def axes_answer(state: ServiceState, now_ns: int) -> AxesAnswer:
    """All axes, in the order of the configuration."""
    answers = [_axis(state, axis, now_ns) for axis in state.axes]
    place = state.place
    return AxesAnswer(
        site=place.site, machine=place.machine, axes=answers, history=state.keeping.place
    )


def history_answer(
    state: ServiceState, axis: str, start_s: float, end_s: float, step_s: float
) -> HistoryAnswer:
    """History of one axis."""
    buckets = state.history(axis, start_s, end_s, step_s)
    return HistoryAnswer(
        axis=axis,
        start=rfc3339_s(start_s),
        end=rfc3339_s(end_s),
        step_s=step_s,
        buckets=[_bucket(bucket) for bucket in buckets],
    )


def event_answer(event: Event) -> EventAnswer:
    """One event."""
    return EventAnswer.model_validate(_event(event))


def _event(event: Event) -> dict[str, Any]:
    members = event.model_dump(exclude={"time_ns"})
    return members | {"time": rfc3339(event.time_ns)}


def _axis(state: ServiceState, axis: str, now_ns: int) -> AxisAnswer:
    path = f"/api/v1/axes/{axis}"
    return AxisAnswer(
        axis=axis,
        condition=state.health(axis, now_ns).condition,
        status=state.preload(axis, now_ns).estimate.status,
        limits=_limits(state.limits(axis)),
        preload=f"{path}/preload",
        health=f"{path}/health",
        history=f"{path}/history",
    )


def _limits(limits: AxisLimits | None) -> LimitsAnswer | None:
    if limits is None:
        return None
    return LimitsAnswer(
        fresh_percent=limits.fresh_percent,
        warning_percent=limits.warning_percent,
        fault_percent=limits.fault_percent,
    )


def _health(health: AxisHealth) -> HealthAnswer:
    return HealthAnswer(
        axis=health.axis,
        condition=health.condition,
        reasons=list(health.reasons),
        since=rfc3339(health.since_time_ns),
        components=[_component(report) for report in health.components],
        data_faults=health.data_faults,
        alarms=[_alarm(alarm) for alarm in health.alarms],
        trend=None if health.trend is None else _trend(health.trend),
        consistency=None if health.consistency is None else _consistency(health.consistency),
    )


def _consistency(consistency: Consistency) -> ConsistencyAnswer:
    return ConsistencyAnswer(
        state=consistency.state,
        ratio=consistency.ratio,
        channel=consistency.channel,
        since=_moment(consistency.since_time_ns),
        recording=consistency.recording,
    )


def _alarm(alarm: Alarm) -> AlarmAnswer:
    return AlarmAnswer(
        alarm=alarm.kind,
        severity=alarm.severity,
        active=alarm.active,
        message=alarm.message,
        raised_at=rfc3339(alarm.raised_time_ns),
        cleared_at=_moment(alarm.cleared_time_ns),
        acknowledged_by=alarm.acknowledged_by,
        note=alarm.note,
        shelved_until=_moment(alarm.shelved_until_ns),
    )


def _trend(trend: Trend) -> TrendAnswer:
    return TrendAnswer(
        status=trend.status,
        reason=trend.reason,
        since=rfc3339(trend.since_time_ns),
        basis=trend.basis,
        level=trend.level,
        rate_percent_per_h=trend.rate_percent_per_h,
        rate_percent_per_km=trend.rate_percent_per_km,
        crossings=[
            CrossingAnswer(
                limit=each.limit,
                limit_percent=each.limit_percent,
                earliest=_moment(each.earliest_ns),
                likely=_moment(each.likely_ns),
                latest=_moment(each.latest_ns),
            )
            for each in trend.crossings
        ],
    )


def _moment(time_ns: int | None) -> str | None:
    return None if time_ns is None else rfc3339(time_ns)


def _component(report: ComponentHealth) -> ComponentAnswer:
    return ComponentAnswer(
        component=report.component,
        axis=report.axis,
        status=report.status,
        reason=report.reason,
        counters=report.counters,
        readings=report.readings,
    )


def _bucket(bucket: Bucket) -> BucketAnswer:
    return BucketAnswer(
        time=rfc3339_s(bucket.start_s),
        samples=bucket.samples,
        estimated=bucket.estimated,
        status=bucket.status,
        low=bucket.low,
        high=bucket.high,
        **{name: _spread(bucket.spreads.get(name)) for name in QUANTITIES},
    )


def _spread(spread: Spread | None) -> SpreadAnswer | None:
    if spread is None:
        return None
    return SpreadAnswer(min=spread.min, max=spread.max, mean=spread.mean)
