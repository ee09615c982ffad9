"""From the state to the answers about one axis' work: traces, use, friction, log."""

from ..health.model_watch.live_features import LivePoint
from ..health.service_state import ServiceState
from ..health.stroke import StrokeBand
from ..messages.samples import Floats
from ..messages.trend import FrictionCurve
from .compose import event_answer
from .times import rfc3339
from .work_answers import (
    ChannelAnswer,
    FrictionAnswer,
    LiveAnswer,
    LogAnswer,
    NumberedEventAnswer,
    ProfileAnswer,
    StrokeAnswer,
    TracesAnswer,
    UseAnswer,
)

_COLUMNS = ("torque_nm", "speed_rad_s", "position_m", "transmission_um", "temperature_c")


def live_answer(axis: str, point: LivePoint) -> LiveAnswer:
    """The newest interval."""
    return LiveAnswer(
        axis=axis,
        time=rfc3339(point.time_ns),
        faults=list(point.faults),
        **{name: _digits(getattr(point, name)) for name in _COLUMNS},
    )


def traces_answer(state: ServiceState, axis: str, since_ns: int) -> TracesAnswer:
    """The last minutes."""
    points = state.live(axis, since_ns)
    return TracesAnswer(
        axis=axis,
        time_s=[point.time_ns / 1e9 for point in points],
        channels=[
            ChannelAnswer(channel=each.channel, state=each.state, good_share=each.good_share)
            for each in state.channels(axis)
        ],
        **{name: [_digits(getattr(point, name)) for point in points] for name in _COLUMNS},
    )


def use_answer(state: ServiceState, axis: str, now_ns: int) -> UseAnswer | None:
    """Use of the screw; None before anything was heard."""
    use = state.health(axis, now_ns).use
    if use is None:
        return None
    members = use.model_dump(exclude={"since_time_ns"})
    return UseAnswer.model_validate(members | {"axis": axis, "since": rfc3339(use.since_time_ns)})


def stroke_answer(state: ServiceState, axis: str, now_ns: int) -> StrokeAnswer | None:
    """Stroke profiles that the estimate implies; None where the axis is not commissioned."""
    stroke = state.stroke(axis)
    if stroke is None:
        return None
    estimate = state.preload(axis, now_ns).estimate
    fresh, now = stroke.fresh_percent, estimate.preload_percent
    told = None if now is None else (now, estimate.low or 0.0, estimate.high or now)
    return StrokeAnswer(
        axis=axis,
        position_m=_rounded(stroke.position_m),
        level=estimate.level,
        preload_percent=_profile(
            stroke.preload(fresh, fresh, fresh), told and stroke.preload(*told)
        ),
        stiffness_n_per_m=(
            _profile(stroke.stiffness(fresh, fresh, fresh), told and stroke.stiffness(*told))
            if stroke.knows_stiffness
            else None
        ),
    )


def _profile(commissioned: StrokeBand, now: StrokeBand | None) -> ProfileAnswer:
    value, low, high = (None, None, None) if now is None else map(_rounded, now)
    return ProfileAnswer(commissioned=_rounded(commissioned[0]), value=value, low=low, high=high)


def _rounded(values: Floats) -> list[float]:
    return [float(f"{value:.5g}") for value in values]


def friction_answer(state: ServiceState, axis: str, now_ns: int) -> FrictionAnswer:
    """The friction curve, empty before anything was heard."""
    curve = state.health(axis, now_ns).friction or FrictionCurve()
    return FrictionAnswer.model_validate(curve.model_dump() | {"axis": axis})


def log_answer(
    state: ServiceState, axis: str, start_s: float, end_s: float, limit: int
) -> LogAnswer:
    """The newest events and notes."""
    events = state.events.between(round(start_s * 1e9), round(end_s * 1e9), axis)
    return LogAnswer(
        axis=axis,
        events=[
            NumberedEventAnswer(id=logged.id, **event_answer(logged.event).model_dump())
            for logged in events[-limit:]
        ],
    )


def _digits(value: float | None) -> float | None:
    """Seven digits: more than any of these was measured with."""
    return None if value is None else float(f"{value:.7g}")
