"""The JSON routes against the contract, the profiles along the stroke among them."""

from dataclasses import replace
from unittest.mock import AsyncMock, Mock

import httpx
import numpy as np
import pytest

from edge_service.health.service_state import ServiceState
from edge_service.health.store.outbox import Counts
from edge_service.http_api.app import create_app
from edge_service.http_api.routes.service import output_items
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import ComponentHealth, ComponentStatus
from edge_service.messages.keys import MachineKeys
from edge_service.models.screw.stroke_profile import StrokeProfile

from .conftest import client_of

NUMBERS = ("preload_percent", "low", "high", "preload_n", "drag_torque_nm", "stiffness_n_per_m")
PATH = "/api/v1/axes/X/wear"
RAMP = StrokeProfile(
    position_m=np.array([0.0, 1.0, 2.0]),
    fresh_percent=10.0,
    preload_share=np.array([0.5, 1.0, 1.5]),
    compliance_m_per_n=np.full(3, 1e-8),
    compliance_tolerance=0.1,
    nut_m_per_n=0.0,
    nut_sigma_m_per_n=0.0,
)
"""Preload rises along two metres; the nut takes no part in the stiffness."""
ONE_ENCODER = replace(RAMP, compliance_m_per_n=np.full(3, np.nan))


async def test_preload_is_the_answer_of_the_contract(scene, client):
    scene.hear_preload(reasons=("warm: the axis is warming up",))
    scene.hear_health()
    scene.wait(0.12)
    answer = await client.get("/api/v1/axes/X/preload")
    assert answer.status_code == 200
    assert (
        answer.json()
        | {
            "axis": "X",
            "status": "estimated",
            "method": None,
            "preload_percent": 6.71,
            "low": 6.58,
            "high": 6.84,
            "level": 0.95,
            "of_fresh": pytest.approx({"value": 67.1, "low": 65.8, "high": 68.4}),
            "preload_n": 500.1,
            "drag_torque_nm": {"value": 0.141, "low": 0.139, "high": 0.143},
            "stiffness_n_per_m": {"value": 3.6e7, "low": 3.4e7, "high": 3.8e7},
            "condition": "NORMAL",
            "reasons": ["warm: the axis is warming up"],
            "mode_probability": {"10": 0.0, "7.5": 0.9, "5": 0.1},
            "fault_probability": {},
            "measured_at": "2026-01-31T12:00:00.000Z",
            "age_s": 0.12,
        }
        == answer.json()
    )


@pytest.mark.parametrize("status", [each for each in EstimateStatus if each != "estimated"])
async def test_numbers_are_null_without_the_status_estimated(scene, client, status):
    scene.hear_preload(status=status)
    answer = (await client.get("/api/v1/axes/X/preload")).json()
    assert answer["status"] == status
    assert [answer[name] for name in NUMBERS] == [None] * 6
    assert answer["mode_probability"] == {}


async def test_stale_preload_has_no_number_but_its_true_time(scene, client):
    scene.hear_preload()
    scene.hear_health()
    scene.wait(2.5)
    answer = (await client.get("/api/v1/axes/X/preload")).json()
    assert answer["status"] == "unestimated"
    assert [answer[name] for name in NUMBERS] == [None] * 6
    assert answer["condition"] == "UNAVAILABLE"
    assert (answer["measured_at"], answer["age_s"]) == ("2026-01-31T12:00:00.000Z", 2.5)
    assert answer["reasons"][0].startswith("stale_input:")


async def test_axis_never_heard_is_there_and_unavailable(client):
    answer = (await client.get("/api/v1/axes/X/preload")).json()
    assert (answer["status"], answer["condition"]) == ("unestimated", "UNAVAILABLE")
    assert (answer["measured_at"], answer["age_s"]) == (None, None)


async def test_axes_the_worst_first_with_limits_and_percent_of_fresh(scene, client):
    scene.hear_all()
    scene.hear_health("Y", AxisCondition.FAULT)
    axes = (await client.get("/api/v1/axes")).json()["axes"]
    assert [(axis["axis"], axis["condition"]) for axis in axes] == [("Y", "FAULT"), ("X", "NORMAL")]
    limits = {"fresh_percent": 10.0, "warning_percent": 6.0, "fault_percent": 3.0}
    assert (axes[1]["limits"], axes[0]["limits"]) == (limits, None)
    assert axes[1]["of_fresh"]["value"] == pytest.approx(67.1)
    assert axes[1]["measured_at"] == "2026-01-31T12:00:00.000Z"
    assert axes[0]["of_fresh"] is None
    drop = {"alarm": "sudden_drop", "level": "FAULT", "text": "d", "raised_at": 1, "active": True}
    scene.hear_health("X", alarms=(drop,))
    scene.hear_health("Y", AxisCondition.WARNING)
    axes = (await client.get("/api/v1/axes")).json()["axes"]
    assert [axis["axis"] for axis in axes] == ["X", "Y"]


async def test_health_of_an_axis(scene, client):
    scene.hear_preload()
    reason = "below_fault: too low"
    scene.hear_health(condition=AxisCondition.FAULT, reasons=(reason,), data_faults={"gap": 2})
    scene.hear_component("acquire", axis="X", counters={"samples": 7})
    answer = (await client.get("/api/v1/axes/X/health")).json()
    assert (answer["condition"], answer["reasons"]) == ("FAULT", [reason])
    assert answer["since"] == "2026-01-31T12:00:00.000Z"
    assert answer["data_faults"] == {"gap": 2}
    assert answer["components"] == [
        {
            "component": "acquire",
            "axis": "X",
            "status": "ok",
            "reason": "",
            "counters": {"samples": 7},
            "readings": {},
        }
    ]


async def test_health_of_the_service(scene, client):
    scene.hear_all()
    scene.hear_component("http")
    answer = (await client.get("/api/v1/health")).json()
    assert (answer["ready"], answer["reasons"]) == (True, [])
    assert [each["component"] for each in answer["components"]] == ["http"]
    scene.wait(60.0)
    answer = (await client.get("/api/v1/health")).json()
    assert not answer["ready"]
    assert answer["components"][0]["status"] == ComponentStatus.RECOVERABLE_ERROR


async def test_alive_and_ready(scene, client):
    assert (await client.get("/healthz")).status_code == 200
    answer = await client.get("/readyz")
    assert answer.status_code == 503
    assert "X: no_input: no preload estimate heard yet" in answer.json()["reasons"]
    scene.hear_all()
    assert (await client.get("/readyz")).status_code == 200
    scene.wait(3.0)
    answer = await client.get("/readyz")
    assert answer.status_code == 503
    assert [reason.split(":")[0] for reason in answer.json()["reasons"]] == ["X", "Y"]
    assert (await client.get("/healthz")).status_code == 200


async def test_standing_axis_is_ready(scene, client):
    scene.hear_all()
    scene.hear_preload(status=EstimateStatus.INSUFFICIENT_EXCITATION)
    assert (await client.get("/readyz")).status_code == 200


async def test_history_in_buckets_without_the_empty_ones(scene, client):
    for percent in (5.0, 7.0, 6.0):
        scene.hear_preload(preload_percent=percent, low=percent - 1, high=percent + 1)
        scene.wait(1.0)
    scene.wait(100.0)
    scene.hear_preload(status=EstimateStatus.INVALID)
    answer = await client.get(
        "/api/v1/axes/X/history",
        params={"from": "2026-01-31T13:00:00+01:00", "to": "1769860920", "step": "10"},
    )
    assert answer.status_code == 200
    history = answer.json()
    assert (history["from"], history["to"]) == (
        "2026-01-31T12:00:00.000Z",
        "2026-01-31T12:02:00.000Z",
    )
    first, last = history["buckets"]
    assert first["time"] == "2026-01-31T12:00:00.000Z"
    assert first["preload_percent"] == {"min": 5.0, "max": 7.0, "mean": 6.0}
    assert (first["low"], first["high"], first["samples"]) == (4.0, 8.0, 3)
    assert last["time"] == "2026-01-31T12:01:40.000Z"
    assert (last["preload_percent"], last["low"], last["status"]) == (None, None, "invalid")


async def test_history_by_default_is_the_last_hour(scene, client):
    scene.hear_preload()
    scene.wait(3000.0)
    scene.hear_preload()
    buckets = (await client.get("/api/v1/axes/X/history")).json()["buckets"]
    assert sum(bucket["samples"] for bucket in buckets) == 2
    scene.wait(3000.0)
    buckets = (await client.get("/api/v1/axes/X/history")).json()["buckets"]
    assert sum(bucket["samples"] for bucket in buckets) == 1


WRONG = """from=noon from=2026-01-31T12:00:00 to=nan to=1e300 to=-1 step=0 step=inf step=0.001
from=1969-12-31T23:00:00Z from=2027-01-01T00:00:00Z"""


@pytest.mark.parametrize("given", WRONG.split())
async def test_bad_parameter_is_named(client, given):
    parameter, value = given.split("=")
    answer = await client.get("/api/v1/axes/X/history", params={parameter: value})
    assert answer.status_code == 422
    problem = answer.json()
    assert [error["parameter"] for error in problem["errors"]] == [parameter]
    assert problem["detail"].startswith(f"{parameter}: ")


@pytest.mark.parametrize(
    ("sent_s", "waits_s", "state"),
    [(0.4, 0.0, "ok"), (0.4, 2.0, "ok"), (0.4, 300.0, "degraded"), (9.0, 0.0, "degraded")],
)
async def test_an_output_is_degraded_by_its_oldest_answer_and_by_what_waits(sent_s, waits_s, state):
    now_ns = 10**18
    report = ComponentHealth(component="mqtt", status="ok", readings={"age_s": sent_s})
    counts = AsyncMock(return_value=Counts(160, 0, now_ns - round(waits_s * 1e9)))
    service = Mock(components=lambda _now_ns, _axis: (report,))
    (item,) = await output_items(service, now_ns, Mock(names=("mqtt",), counts=counts))
    assert (item.state, item.waiting) == (state, 160)
    assert item.age_s == pytest.approx(max(sent_s, waits_s))


def telling(scene, profile: StrokeProfile | None) -> httpx.AsyncClient:
    scene.state = ServiceState({"X": None}, scene.now_ns, place=MachineKeys("hall", "m1"))
    app = create_app(
        scene.state,
        lambda: scene.now_ns,
        read_stroke=lambda _axis, preload: profile and profile.told(preload),
    )
    return client_of(app)


async def test_the_estimate_is_spread_along_the_stroke(scene):
    async with telling(scene, RAMP) as client:
        scene.hear_preload(preload_percent=4.0, low=3.0, high=5.0)
        answer = (await client.get(PATH)).json()["stroke"]
    assert answer["position_m"] == [0.0, 1.0, 2.0]
    assert answer["preload_percent"] == {
        "commissioned": [5.0, 10.0, 15.0],
        "value": [2.0, 4.0, 6.0],
        "low": [1.5, 3.0, 4.5],
        "high": [2.5, 5.0, 7.5],
    }
    stiffness = answer["stiffness_n_per_m"]
    assert stiffness["value"] == stiffness["commissioned"] == [1e8, 1e8, 1e8]
    assert stiffness["low"] == [pytest.approx(1e8 / 1.196, rel=1e-4)] * 3


async def test_one_encoder_knows_no_stiffness_and_no_commissioning_nothing(scene):
    async with telling(scene, ONE_ENCODER) as client:
        scene.hear_preload()
        answer = (await client.get(PATH)).json()["stroke"]
        assert answer["preload_percent"]["value"] is not None
        assert answer["stiffness_n_per_m"] is None
    async with telling(scene, None) as client:
        answer = await client.get(PATH)
        assert (answer.status_code, answer.json()["stroke"]) == (200, None)


async def test_the_axes_say_which_machine_they_belong_to(scene):
    async with telling(scene, None) as client:
        answer = (await client.get("/api/v1/axes")).json()
    assert (answer["site"], answer["machine"]) == ("hall", "m1")
