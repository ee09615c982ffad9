"""Every JSON answer is, character by character, the one that version 0.1.0 gave."""

import json
from pathlib import Path

import httpx
import numpy as np
import pytest

from edge_service import __version__
from edge_service.health.service_state import ServiceState
from edge_service.health.settings import HealthSettings
from edge_service.http_api.app import create_app
from edge_service.http_api.jobs import JobAnswer, JobKind, JobState, RecordingAnswer
from edge_service.messages.alarm import Alarm, AlarmKind
from edge_service.messages.estimate import EstimateStatus, Interval, PreloadEstimate
from edge_service.messages.event import Event, Severity
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock
from edge_service.messages.header import Header
from edge_service.messages.health import (
    AxisCondition,
    AxisHealth,
    ComponentHealth,
    ComponentStatus,
    Consistency,
    ConsistencyState,
)
from edge_service.messages.keys import MachineKeys
from edge_service.messages.trend import Crossing, FrictionCurve, Trend, TrendStatus, Use

RECORDED = json.loads(Path(__file__).with_name("recorded_answers.json").read_text())
NS = 1_000_000_000
NOW_NS = 1_769_860_800 * NS + 120_000_000
EARLIER_NS = NOW_NS - 7 * NS
ESTIMATE = PreloadEstimate(
    time_s=12.0,
    status=EstimateStatus.ESTIMATED,
    reasons=("warm: the axis is warming up",),
    preload_percent=6.71,
    low=6.58,
    high=6.84,
    preload_n=500.1,
    drag_torque_nm=Interval(value=0.141, low=0.139, high=0.143),
    stiffness_n_per_m=Interval(value=3.6e7, low=3.4e7, high=3.8e7),
    mode_probability={"10": 0.0, "7.5": 0.9, "5": 0.1},
    fault_probability={"preload_loss": 0.02, "looseness": 0.0},
    data_used_s=4.0,
    nis=1.1,
)
ALARM = Alarm(
    kind=AlarmKind.RATE,
    severity=Severity.WARNING,
    active=True,
    message="fast",
    raised_time_ns=EARLIER_NS,
    cleared_time_ns=NOW_NS,
    acknowledged_by="Kim",
    note="seen",
    shelved_until_ns=NOW_NS + NS,
)
TREND = Trend(
    status=TrendStatus.FALLING,
    reason="the preload falls",
    since_time_ns=EARLIER_NS,
    basis="distance",
    rate_percent_per_h=Interval(value=-1.2e-3, low=-1.4e-3, high=-1e-3),
    crossings=(
        Crossing(
            limit="fault",
            limit_percent=3.0,
            earliest_ns=NOW_NS + NS,
            likely_ns=NOW_NS + 2 * NS,
            latest_ns=None,
        ),
    ),
)
USE = Use(
    since_time_ns=EARLIER_NS,
    moving_s=3.5,
    observed_s=7.0,
    distance_m=1.25,
    reversals=4,
    stroke_from_m=0.0,
    stroke_to_m=0.8,
    way_m=(0.5, 0.75),
    force_edges_n=(0.0, 50.0, 100.0),
    force_way_m=(1.0, 0.25),
)
ACQUIRE = ComponentHealth(
    component="acquire",
    axis="X",
    status=ComponentStatus.OK,
    counters={"samples": 7},
    readings={"true_preload_percent": 6.7},
)
HEALTH = AxisHealth(
    axis="X",
    condition=AxisCondition.WARNING,
    reasons=("below_warning: low",),
    since_time_ns=EARLIER_NS,
    components=(ACQUIRE,),
    data_faults={"gap": 2},
    alarms=(ALARM, ALARM.model_copy(update={"kind": AlarmKind.MODEL, "cleared_time_ns": None})),
    trend=TREND,
    use=USE,
    friction=FrictionCurve(
        speed_rad_s=(-2.0, 2.0), torque_nm=(-0.1, 0.1), first_torque_nm=(-0.2, 0.2), count=(3, 4)
    ),
    consistency=Consistency(
        state=ConsistencyState.DISAGREES,
        ratio={"torque_nm": 1.2},
        channel="torque_nm",
        since_time_ns=EARLIER_NS,
        recording="disagreement_X_20260131T120000Z.parquet",
    ),
)
JOB = JobAnswer(
    id=1,
    kind=JobKind.DIAGNOSE,
    axis="X",
    recordings=["a.csv"],
    baseline=None,
    state=JobState.DONE,
    started="2026-01-31T12:00:00.000Z",
    ended=None,
    lines=["working"],
    files=["diagnosis.json"],
)


class _Ramp:
    """A stroke model whose values can be reckoned by hand."""

    position_m = np.array([0.0, 1.0])
    fresh_percent = 10.0
    knows_stiffness = True

    def preload(self, percent: float, low: float, high: float):
        shape = np.array([0.5, 1.5])
        return percent * shape, low * shape, high * shape

    def stiffness(self, percent: float, low: float, high: float):
        return tuple(1e6 * each for each in self.preload(percent, low, high))


class _Desk:
    """A desk with one recording and one job."""

    def recordings(self) -> list[RecordingAnswer]:
        return [RecordingAnswer(name="a.csv", size=7, uploaded="2026-01-31T12:00:00.000Z")]

    def jobs(self) -> list[JobAnswer]:
        return [JOB]


def state_of_two_axes() -> ServiceState:
    """X has heard everything; Y has heard a number that has gone stale."""
    state = ServiceState(
        {"X": HealthSettings().limits(10.0), "Y": None},
        EARLIER_NS,
        strokes={"X": _Ramp()},
        place=MachineKeys("hall", "m1"),
    )
    numbers = dict.fromkeys(FEATURE_FIELDS, 0.25) | {"fault": Fault.NONE, "reversal_count": 0}
    holes = {"fault": Fault.HOLE | Fault.NO_TABLE, "table_mean_m": float("nan")}
    for sequence, more in enumerate(({}, holes)):
        header = Header(sequence, 1, NOW_NS - (2 - sequence) * NS // 10, 0)
        state.on_feature("X", header, FeatureBlock(**(numbers | more)))
    state.on_preload("X", Header(1, 1, NOW_NS - NS // 10, 0), ESTIMATE, NOW_NS)
    state.on_preload("Y", Header(1, 1, EARLIER_NS, 0), ESTIMATE, EARLIER_NS)
    state.on_health(Header(1, 1, NOW_NS, 0), HEALTH, NOW_NS)
    state.on_component(ComponentHealth(component="http", status=ComponentStatus.OK), NOW_NS)
    for axis in ("X", ""):
        data = {"alarm": "rate", "count": 1, "share": 0.5, "none": None}
        event = Event(
            axis=axis,
            kind="alarm_raised",
            severity=Severity.WARNING,
            message="fast",
            time_ns=EARLIER_NS,
            data=data,
        )
        state.events.add((event,), NOW_NS)
    return state


async def answer_to(path: str) -> str:
    """Body of the answer to a GET."""
    app = create_app(state_of_two_axes(), lambda: NOW_NS, desk=_Desk())
    transport = httpx.ASGITransport(app=app)
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        return (await client.get(path)).text


@pytest.mark.parametrize("path", [path for path in RECORDED if path != "/api/v1/schemas"])
async def test_an_answer_stays_as_it_was(path: str) -> None:
    assert await answer_to(path) == RECORDED[path].replace("{version}", __version__)


def _without_descriptions(schema: object) -> object:
    if isinstance(schema, list):
        return [_without_descriptions(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    return [(k, _without_descriptions(v)) for k, v in schema.items() if k != "description"]


async def test_the_schemas_of_the_payloads_stay_as_they_were() -> None:
    """In their order; the descriptions, which are docstrings, are free."""
    path = "/api/v1/schemas"
    shown = json.loads(await answer_to(path))
    assert _without_descriptions(shown) == _without_descriptions(json.loads(RECORDED[path]))


async def test_the_routes_stay_as_they_were() -> None:
    """Paths, methods, parameters and statuses; the names of the schemas are free."""
    shown = json.loads(await answer_to("/openapi.json"))["paths"]
    routes = {
        f"{method} {path}": {
            "parameters": route.get("parameters", []),
            "statuses": sorted(route["responses"]),
        }
        for path, methods in shown.items()
        for method, route in methods.items()
    }
    assert routes == json.loads(Path(__file__).with_name("recorded_routes.json").read_text())
