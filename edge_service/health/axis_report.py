"""Words of a fleet on one axis."""

from collections.abc import Sequence

from ..messages.estimate import EstimateStatus, Interval

_H_PER_RATE = 1000.0


def fits(status: str, *, doubted: bool) -> bool | None:
    """Tell whether the model fits; None if nobody can tell.

    Args:
        status: of the estimate, one of `EstimateStatus`.
        doubted: whether the alarm `model` is active.
    """
    if doubted or status == EstimateStatus.INVALID:
        return False
    return True if status == EstimateStatus.ESTIMATED else None


def loss_per_1000_h(rate: Interval, fresh_percent: float) -> Interval:
    """Loss in percent of the fresh screw's preload per 1000 h.

    Args:
        rate: change in percent of the load rating per hour.
        fresh_percent: preload of the fresh screw, percent of the load rating, not 0.
    """
    scale = -100.0 * _H_PER_RATE / fresh_percent
    return Interval(value=scale * rate.value, low=scale * rate.high, high=scale * rate.low)


def sentence(reasons: Sequence[str]) -> str:
    """Sentence of the first reason; empty if there is none.

    >>> sentence(["no_input: no preload estimate heard yet", "other: more"])
    'no preload estimate heard yet'
    """
    return reasons[0].partition(": ")[2] if reasons else ""
