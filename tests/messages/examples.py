"""One payload of every topic, and estimates and events that differ in what a test is about."""

from typing import Any

import numpy as np

from edge_service.messages import health
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus, ImmEstimate, PreloadEstimate
from edge_service.messages.event import AxisCondition, Event
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock, Phase
from edge_service.messages.health import AlarmKind, Command, Outcome
from edge_service.messages.interval import Interval
from edge_service.messages.samples import ANGLE, TORQUE, Quality, SampleFrame, Waveform
from edge_service.messages.trend import Crossing, FrictionCurve, Trend, TrendStatus, Use

from .answers import alarm_of


def estimate_of(
    percent: float | None = None, half_width: float = 0.1, **more: Any
) -> PreloadEstimate:
    """An estimate with its number and bounds, in percent; without a percent it has none."""
    members: dict[str, Any] = {"time_s": 0.0, "status": EstimateStatus.UNESTIMATED}
    if percent is not None:
        members |= {"status": EstimateStatus.ESTIMATED, "preload_percent": percent}
        members |= {"low": percent - half_width, "high": percent + half_width}
    return PreloadEstimate.model_validate(members | more)


def event_of(text: str = "m", **more: Any) -> Event:
    members = {"axis": "X", "kind": "note", "level": AxisCondition.NORMAL, "time_ns": 1}
    return Event.model_validate(members | {"text": text} | more)


HEADER = Header(7, 1_790_000_000_000_000_001, 1_790_000_000_000_000_002, 3)
TIME_S = np.array([0.0, 1e-3, 2e-3])
INTERVAL = Interval(value=0.14, low=0.13, high=0.15)
NUMBERS: dict[str, Any] = {name: float(index) for index, name in enumerate(FEATURE_FIELDS)} | {
    "fault": Fault.HOLE | Fault.REPEAT,
    "sample_count": 3,
    "reversal_count": 1,
    "temperature_c": float("nan"),
}
USE = Use(
    since_time_ns=1_000_000,
    moving_s=2.0,
    observed_s=3.0,
    distance_m=4.5,
    reversals=5,
    stroke_from_m=0.0,
    stroke_to_m=0.8,
    way_m=(0.25,),
    force_edges_n=(0.0, 50.0),
    force_way_m=(1.5,),
)
CROSSING = Crossing(
    limit="fault", limit_percent=3.0, earliest_ns=1_000_000, likely_ns=2_000_000, latest_ns=None
)
HEALTH = health.AxisHealth(
    axis="X",
    condition=AxisCondition.WARNING,
    reasons=("below_warning: low",),
    since_time_ns=4_000_000,
    components=(
        health.ComponentHealth(component="estimate", axis="X", status=health.ComponentStatus.OK),
    ),
    data_faults={"gap": 2},
    alarms=(alarm_of(AlarmKind.RATE, level="WARNING", text="fast", raised_time_ns=5_000_000),),
    trend=Trend(
        status=TrendStatus.FALLING,
        reason="falls",
        since_time_ns=1_000_000,
        rate_percent_per_h=INTERVAL,
        crossings=(CROSSING,),
    ),
    use=USE,
    friction=FrictionCurve(
        speed_rad_s=(2.0,), torque_nm=(0.1,), first_torque_nm=(0.2,), count=(3,)
    ),
    consistency=health.Consistency(),
)
PAYLOADS: dict[str, Any] = {
    "raw": SampleFrame(
        TIME_S,
        {TORQUE: np.array([0.1, np.nan, 0.3]), ANGLE: np.array([1.0, 2.0, 3.0]), "own": TIME_S},
        {TORQUE: np.array([0, Quality.NO_VALUE, 0], np.uint8), ANGLE: np.zeros(3, np.uint8)},
    ),
    "feat": FeatureBlock(**(NUMBERS | {"cruising": Phase(0.05, 0.1, 0.2, 3.0, 4.0, 0.5)})),
    "preload": PreloadEstimate(
        time_s=1.5,
        status=EstimateStatus.ESTIMATED,
        reasons=("warm: warming up",),
        preload_percent=6.7,
        low=6.5,
        high=6.9,
        drag_torque_nm=INTERVAL,
        mode_probability={"10": 0.1, "7.5": 0.9},
    ),
    "imm": ImmEstimate(axis="X", low=6.5, mode_probability={"10": 0.1}, measured_time_ns=9_000_000),
    "health": HEALTH,
    "event": Event(
        axis="X",
        kind="alarm_raised",
        level=AxisCondition.FAULT,
        text="m",
        time_ns=9_000_000,
        data={"alarm": "rate", "count": 1, "share": 0.5, "none": None},
    ),
    "command": Command(action="acknowledge", alarm=health.AlarmKind.RATE, user="Kim", note="seen"),
    "status": health.ComponentHealth(
        component="http",
        status=health.ComponentStatus.RECOVERABLE_ERROR,
        reason="port",
        counters={"received": 3},
        readings={"true_preload_percent": 6.5},
    ),
    "wave": Waveform("nut_acceleration", "m/s^2", 0.5, 1e-4, np.array([1.0, 2.0, 4.0])),
    "outcome": Outcome(accepted=False, message="there is no alarm rate to acknowledge"),
}
