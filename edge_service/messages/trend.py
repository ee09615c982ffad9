"""Outlook for the preload, and use of the screw so far."""

from enum import StrEnum

from pydantic import Field

from .interval import Frozen, Interval, TimeNs


class TrendStatus(StrEnum):
    """Status of a trend; `too_early` while none can be estimated."""

    TOO_EARLY = "too_early"  # too little history since the trend began
    STEADY = "steady"  # no significant change
    FALLING = "falling"
    FELL = "fell"  # until then; nothing tells of a fall since
    RISING = "rising"  # parts do not heal: something else changed


class Crossing(Frozen):
    """Time at which a limit will be reached, if the wear goes on as it does.

    Attributes:
        limit, limit_percent: `warning` or `fault`, and the limit in percent of the load rating.
        earliest_ns, likely_ns, latest_ns: UNIX times, ns: the bounds of the band and its middle;
            None where no time within the horizon can be named.
    """

    limit: str
    limit_percent: float
    earliest_ns: TimeNs | None = Field(alias="earliest")
    likely_ns: TimeNs | None = Field(alias="likely")
    latest_ns: TimeNs | None = Field(alias="latest")


class Trend(Frozen):
    """Trend of the preload: how it changes, since when, and when it reaches its limits.

    Attributes:
        reason: one sentence for people.
        since_time_ns, until_time_ns: start and end of the history that it rests on, or of the fall
            that is over, UNIX ns; None while there is none.
        basis: what the wear is counted against, `time` or `distance`.
        level: probability that each interval and band aims to hold the truth.
        rate_percent_per_h: change of the preload now, percent of the load rating per hour.
        rate_fresh_percent_per_h: the same in percent of the fresh screw's preload; None where that
            is not known.
        change_fresh_percent: change over the history, in the same unit.
        crossings: empty unless the preload is falling.
    """

    status: TrendStatus
    reason: str
    since_time_ns: TimeNs | None = Field(alias="since")
    until_time_ns: TimeNs | None = Field(None, alias="until")
    basis: str = "time"
    level: float = 0.9
    rate_percent_per_h: Interval | None = None
    rate_fresh_percent_per_h: Interval | None = None
    change_fresh_percent: float | None = None
    crossings: tuple[Crossing, ...] = ()


class Use(Frozen):
    """Use of the screw since the part was put into service.

    Attributes:
        since_time_ns: when the part came into use, UNIX ns.
        moving_s, observed_s: time in motion and time with good data, s.
        distance_m: way of the table, m.
        reversals: changes of direction.
        stroke_from_m, stroke_to_m: ends of the map, m.
        way_m: way worked in each equal part of the stroke, m.
        force_edges_n: edges of the load spectrum, N, one more than its parts.
        force_way_m: way worked under a mean axial drive force within each part, m.
    """

    since_time_ns: TimeNs = Field(alias="since")
    moving_s: float
    observed_s: float
    distance_m: float
    reversals: int
    stroke_from_m: float
    stroke_to_m: float
    way_m: tuple[float, ...]
    force_edges_n: tuple[float, ...]
    force_way_m: tuple[float, ...]


class StrokeBand(Frozen):
    """A quantity along the stroke, (n,): as commissioned, and as an estimate implies now.

    Attributes:
        value, low, high: None while there is no estimate.
    """

    commissioned: tuple[float, ...]
    value: tuple[float, ...] | None = None
    low: tuple[float, ...] | None = None
    high: tuple[float, ...] | None = None


class Stroke(Frozen):
    """Preload and stiffness along the stroke.

    The shape along the stroke is that of the commissioned axis, its level that of the estimate.

    Attributes:
        position_m: places of the table, m, (n,).
        level: probability with which each interval holds the truth.
        stiffness_n_per_m: None without a linear encoder.
    """

    position_m: tuple[float, ...]
    level: float
    preload_percent: StrokeBand
    stiffness_n_per_m: StrokeBand | None


class FrictionCurve(Frozen):
    """Torque at steady speed, per class of speed.

    Attributes:
        speed_rad_s: mean speed of each class, rad/s, rising, (n,).
        torque_nm: mean torque of the newest intervals, N m, (n,).
        first_torque_nm: the same of the first intervals since the part is in use, (n,).
        count: intervals in each class, (n,).
    """

    speed_rad_s: tuple[float, ...] = ()
    torque_nm: tuple[float, ...] = ()
    first_torque_nm: tuple[float, ...] = ()
    count: tuple[int, ...] = ()
