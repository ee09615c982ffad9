"""From the board to the answers about one axis' work: traces, use, friction, log."""

from ..health.board import Board
from ..health.live_features import LivePoint
from ..messages.outlook import FrictionCurve
from .compose import event_answer
from .times import rfc3339
from .work_answers import (
    ChannelAnswer,
    FrictionAnswer,
    LiveAnswer,
    LogAnswer,
    NumberedEventAnswer,
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


def traces_answer(board: Board, axis: str, since_ns: int) -> TracesAnswer:
    """The last minutes."""
    points = board.live(axis, since_ns)
    return TracesAnswer(
        axis=axis,
        time_s=[point.time_ns / 1e9 for point in points],
        channels=[
            ChannelAnswer(channel=each.channel, state=each.state, good_share=each.good_share)
            for each in board.channels(axis)
        ],
        **{name: [_digits(getattr(point, name)) for point in points] for name in _COLUMNS},
    )


def use_answer(board: Board, axis: str, now_ns: int) -> UseAnswer | None:
    """What the screw has done; None before anything was heard."""
    use = board.health(axis, now_ns).use
    if use is None:
        return None
    members = use.model_dump(exclude={"since_time_ns"})
    return UseAnswer.model_validate(members | {"axis": axis, "since": rfc3339(use.since_time_ns)})


def friction_answer(board: Board, axis: str, now_ns: int) -> FrictionAnswer:
    """The friction curve, empty before anything was heard."""
    curve = board.health(axis, now_ns).friction or FrictionCurve()
    return FrictionAnswer.model_validate(curve.model_dump() | {"axis": axis})


def log_answer(board: Board, axis: str, start_s: float, end_s: float, limit: int) -> LogAnswer:
    """The newest events and notes."""
    events = board.events.between(round(start_s * 1e9), round(end_s * 1e9), axis)
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
