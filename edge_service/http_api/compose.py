"""Answers of the JSON routes, composed from the service state."""

from dataclasses import asdict, fields
from typing import Any

from .. import __version__
from ..health.axis_state import StrokeBand
from ..health.live_features import LivePoint
from ..health.service_state import ServiceState
from ..messages.answer import of_fresh, reasons_together
from ..messages.estimate import PreloadEstimate
from ..messages.health import AxisHealth
from ..messages.samples import Floats
from ..messages.trend import FrictionCurve
from .answers import (
    AxesAnswer,
    AxisRow,
    BucketAnswer,
    HealthAnswer,
    HistoryAnswer,
    PreloadAnswer,
    ServiceAnswer,
)
from .axis_answers import (
    FrictionAnswer,
    LiveAnswer,
    ProfileAnswer,
    StrokeAnswer,
    TracesAnswer,
    UseAnswer,
)
from .times import rfc3339, rfc3339_s

_OF_ESTIMATE = PreloadAnswer.model_fields.keys() & PreloadEstimate.model_fields.keys()
_OF_LIVE_POINT = [
    field.name for field in fields(LivePoint) if field.name in TracesAnswer.model_fields
]


def preload_answer(state: ServiceState, axis: str, now_ns: int) -> PreloadAnswer:
    """Preload of one axis with its condition."""
    reading = state.preload(axis, now_ns)
    health = state.health(axis, now_ns)
    estimate = reading.estimate
    members: dict[str, Any] = {name: getattr(estimate, name) for name in _OF_ESTIMATE}
    members |= {"condition": health.condition, "measured_at": reading.measured_ns}
    reasons = list(reasons_together(health.reasons, estimate.reasons))
    members |= {"reasons": reasons, "age_s": reading.age_s}
    limits = state.limits(axis)
    fresh = of_fresh(estimate, None if limits is None else limits.fresh_percent)
    return PreloadAnswer(axis=axis, of_fresh=fresh, **members)


def health_answer(state: ServiceState, axis: str, now_ns: int) -> HealthAnswer:
    """Condition of one axis."""
    return HealthAnswer.model_validate(state.health(axis, now_ns))


def service_answer(state: ServiceState, now_ns: int) -> ServiceAnswer:
    """Health of the whole service."""
    reasons = state.unready(now_ns)
    return ServiceAnswer(
        time=rfc3339(now_ns),
        ready=not reasons,
        reasons=list(reasons),
        version=__version__,
        configuration=state.configuration,
        components=list(state.components(now_ns)),
        axes=[health_answer(state, axis, now_ns) for axis in state.axes],
    )


def axes_answer(state: ServiceState, now_ns: int) -> AxesAnswer:
    """All axes, the worst first."""
    rows = [axis_row(state.health(axis, now_ns), now_ns) for axis in state.axes]
    return AxesAnswer(
        site=state.place.site,
        machine=state.place.machine,
        axes=sorted(rows, key=lambda row: row.urgency),
        history=state.kept,
    )


def axis_row(health: AxisHealth, now_ns: int) -> AxisRow:
    """Row of an axis from the last word on it."""
    names = AxisRow.model_fields.keys() & AxisHealth.model_fields.keys()
    measured_ns, trend = health.measured_time_ns, health.trend
    return AxisRow(
        **{name: getattr(health, name) for name in names},
        measured_at=measured_ns,
        age_s=None if measured_ns is None else max(now_ns - measured_ns, 0) / 1e9,
        rate_fresh_percent_per_h=None if trend is None else trend.rate_fresh_percent_per_h,
    )


def history_answer(
    state: ServiceState, axis: str, start_s: float, end_s: float, step_s: float
) -> HistoryAnswer:
    """History of one axis."""
    buckets = state.history.buckets(axis, start_s, end_s, step_s)
    return HistoryAnswer(
        axis=axis,
        start=rfc3339_s(start_s),
        end=rfc3339_s(end_s),
        step_s=step_s,
        buckets=[BucketAnswer.model_validate(bucket) for bucket in buckets],
    )


def live_answer(axis: str, point: LivePoint) -> LiveAnswer:
    """The newest interval."""
    return LiveAnswer.model_validate(asdict(point) | {"axis": axis})


def traces_answer(state: ServiceState, axis: str, since_ns: int) -> TracesAnswer:
    """The last minutes."""
    points = state.live(axis, since_ns)
    return TracesAnswer(
        axis=axis,
        time_s=[point.time_ns / 1e9 for point in points],
        channels=list(state.channels(axis)),
        **{name: [getattr(point, name) for point in points] for name in _OF_LIVE_POINT},
    )


def use_answer(state: ServiceState, axis: str, now_ns: int) -> UseAnswer | None:
    """Use of the screw; None before anything was heard."""
    use = state.health(axis, now_ns).use
    return None if use is None else UseAnswer.model_validate(dict(use) | {"axis": axis})


def friction_answer(state: ServiceState, axis: str, now_ns: int) -> FrictionAnswer:
    """The friction curve, empty before anything was heard."""
    curve = state.health(axis, now_ns).friction or FrictionCurve()
    return FrictionAnswer.model_validate(dict(curve) | {"axis": axis})


def stroke_answer(state: ServiceState, axis: str, now_ns: int) -> StrokeAnswer | None:
    """Stroke profiles that the estimate implies; None where the axis is not commissioned."""
    stroke = state.stroke(axis)
    if stroke is None:
        return None
    estimate = state.preload(axis, now_ns).estimate
    fresh, now = stroke.fresh_percent, estimate.preload_percent
    present = None if now is None else (now, estimate.low or 0.0, estimate.high or now)
    return StrokeAnswer(
        axis=axis,
        position_m=_rounded(stroke.position_m),
        level=estimate.level,
        preload_percent=_profile(
            stroke.preload(fresh, fresh, fresh), present and stroke.preload(*present)
        ),
        stiffness_n_per_m=(
            _profile(stroke.stiffness(fresh, fresh, fresh), present and stroke.stiffness(*present))
            if stroke.knows_stiffness
            else None
        ),
    )


def _profile(commissioned: StrokeBand, now: StrokeBand | None) -> ProfileAnswer:
    value, low, high = (None, None, None) if now is None else map(_rounded, now)
    return ProfileAnswer(commissioned=_rounded(commissioned[0]), value=value, low=low, high=high)


def _rounded(values: Floats) -> list[float]:
    return [float(f"{value:.5g}") for value in values]
