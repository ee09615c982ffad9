"""Output of an estimator."""

from enum import StrEnum

from pydantic import Field

from .interval import Frozen, Interval, TimeNs


class EstimateStatus(StrEnum):
    """Validity of an estimate: whether its numbers may be read."""

    ESTIMATED = "estimated"
    UNESTIMATED = "unestimated"  # not enough data yet, or the data cannot tell
    INSUFFICIENT_EXCITATION = "insufficient_excitation"  # too little motion without a force lately
    INVALID = "invalid"  # model and data disagree, or the data are faulty


class PreloadEstimate(Frozen):
    """Preload of one axis at one moment; numbers are None unless the status is `estimated`.

    Attributes:
        time_s: end of the interval that it rests on, on the axis' clock, s.
        status: whether the numbers may be read.
        method: of the estimator that says so; None before any has.
        reasons: why there is no number, or what to keep in mind; `code: sentence`.
        preload_percent: percent of the dynamic load rating, with its `low` and `high` bounds.
        level: probability that the interval [low, high] aims to hold the truth.
        preload_n: the same in newton.
        drag_torque_nm: the Coulomb drag torque of the axis at the motor shaft, N m.
        stiffness_n_per_m: of all that lies in series between motor and table, N/m; None from an
            estimator that does not know it.
        mode_probability: probability of each preload level by the estimator that `method` names.
        fault_probability: probability of each change since commissioning: `preload_loss` of 10 %,
            `lubrication` (friction at the same preload up by 20 % of the whole), `payload` of 10 %
            of the table, `looseness` (coupling, bearings or screw yield more, by 10 % of the whole
            compliance), and that a `process_force` acts now; `payload` and `looseness` with two
            encoders only; empty from an estimator that does not know them.
        data_used_s: time of informative motion behind the estimate, s.
        nis: normalised innovation squared of the last informative interval (mean 1 if the
            model holds).
    """

    time_s: float
    status: EstimateStatus
    method: str | None = None
    reasons: tuple[str, ...] = ()
    preload_percent: float | None = None
    low: float | None = None
    high: float | None = None
    level: float = 0.95
    preload_n: float | None = None
    drag_torque_nm: Interval | None = None
    stiffness_n_per_m: Interval | None = None
    mode_probability: dict[str, float] = {}
    fault_probability: dict[str, float] = {}
    data_used_s: float = 0.0
    nis: float | None = None


class ImmEstimate(Frozen):
    """Second opinion on an axis, by the thesis' five levels and the drag alone.

    Numbers are as in PreloadEstimate, which also has the reasons for a status.

    Attributes:
        engine: of the filters; None before any has spoken.
        measured_time_ns: UNIX time of the newest sample behind it, ns; `measured_at` in JSON.
    """

    axis: str
    status: EstimateStatus = EstimateStatus.UNESTIMATED
    preload_percent: float | None = None
    low: float | None = None
    high: float | None = None
    mode_probability: dict[str, float] = {}
    engine: str | None = None
    measured_time_ns: TimeNs | None = Field(None, alias="measured_at")
