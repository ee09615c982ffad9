"""Tests of commands to an axis, of its alarms, use, friction, traces and log, and its download."""

import io

import numpy as np
import pyarrow.parquet as pq
import pytest

from edge_service.messages.event import AxisCondition
from edge_service.messages.features import FEATURE_FIELDS, Fault, FeatureBlock
from edge_service.messages.health import AlarmKind, Command, Outcome
from edge_service.messages.trend import Crossing, FrictionCurve, Trend, TrendStatus

from ..messages.answers import alarm_of
from ..messages.examples import USE

NS = 1_000_000_000
BASE = "/api/v1/axes/X"


@pytest.fixture
def sent(scene) -> list[tuple[str, Command]]:
    taken: list[tuple[str, Command]] = []

    async def send(axis: str, command: Command) -> Outcome:
        taken.append((axis, command))
        return Outcome(accepted=True, message="seen (Kim)")

    scene.app.state.send_command = send
    return taken


def _feature(**values: object) -> FeatureBlock:
    members = dict.fromkeys(FEATURE_FIELDS, 0.0) | {"fault": Fault.NONE, "reversal_count": 0}
    return FeatureBlock(**(members | values))


async def test_a_command_is_passed_on(client, sent):
    body = {"action": "acknowledge", "alarm": "sudden_drop", "occurrence": 7}
    body |= {"user": "Kim", "note": "seen"}
    answer = await client.post(f"{BASE}/commands", json=body)
    assert answer.status_code == 202
    assert answer.json() == {"outcome": "seen (Kim)"}
    ((axis, command),) = sent
    assert axis == "X"
    assert command == Command(
        action="acknowledge",
        alarm=AlarmKind.SUDDEN_DROP,
        occurrence=7,
        user="Kim",
        note="seen",
        origin="127.0.0.1",
    )


@pytest.mark.parametrize(
    ("outcome", "status", "said"),
    [
        (None, 503, "does not answer"),
        (Outcome(accepted=False, message="there is no alarm rate"), 409, "there is no alarm rate"),
        (Outcome(accepted=True, kept=False, message="disk full"), 507, "disk full"),
    ],
)
async def test_a_command_that_is_not_done_and_kept_is_not_accepted(
    client, scene, outcome, status, said
):
    async def send(_axis: str, _command: Command) -> Outcome | None:
        return outcome

    scene.app.state.send_command = send
    body = {"action": "acknowledge", "alarm": "rate", "occurrence": 7, "user": "Kim"}
    answer = await client.post(f"{BASE}/commands", json=body)
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert said in answer.json()["detail"]


@pytest.mark.parametrize(
    ("change", "parameter"),
    [
        ({"action": "explode"}, "action"),
        ({"alarm": None}, "alarm"),
        ({"action": "note"}, "alarm"),
        ({"alarm": "fire"}, "alarm"),
        ({"occurrence": None}, "occurrence"),
        ({"action": "shelve"}, "occurrence"),
        ({"user": ""}, "user"),
        ({"duration_s": -1.0}, "duration_s"),
        ({"more": 1}, "more"),
    ],
)
async def test_a_wrong_command_is_told_by_its_member(client, sent, change, parameter):
    body = {"action": "acknowledge", "alarm": "rate", "occurrence": 7, "user": "Kim"} | change
    answer = await client.post(f"{BASE}/commands", json=body)
    assert answer.status_code == 422
    assert [each["parameter"] for each in answer.json()["errors"]] == [parameter]
    assert sent == []


async def test_a_body_of_another_kind_is_no_json(client, sent):
    given = {"content": b'{"action": "note"}', "headers": {"content-type": "text/plain"}}
    answer = await client.post("/api/v1/axes/X/commands", **given)
    assert (answer.status_code, "text/plain" in answer.json()["detail"]) == (415, True)
    assert not sent


async def test_without_a_monitor_nothing_is_taken(client):
    body = {"action": "note", "user": "Kim"}
    assert (await client.post(f"{BASE}/commands", json=body)).status_code == 503
    assert (await client.post("/api/v1/axes/Q/commands", json=body)).status_code == 404


async def test_alarms_and_trend_are_told(scene, client):
    facts = {"level": AxisCondition.WARNING, "text": "fast", "raised_time_ns": scene.now_ns}
    alarm = alarm_of(AlarmKind.RATE, **facts)
    crossing = Crossing(
        limit="fault",
        limit_percent=3.0,
        earliest_ns=scene.now_ns + NS,
        likely_ns=scene.now_ns + 2 * NS,
        latest_ns=None,
    )
    trend = Trend(
        status=TrendStatus.FALLING,
        reason="falls",
        since_time_ns=scene.now_ns,
        crossings=(crossing,),
    )
    scene.hear_preload()
    scene.hear_health(alarms=(alarm,), trend=trend)
    answer = (await client.get(f"{BASE}/health")).json()
    assert answer["alarms"][0] == {
        "alarm": "rate",
        "occurrence": 0,
        "level": "WARNING",
        "active": True,
        "code": "",
        "text": "fast",
        "values": {},
        "raised_at": "2026-01-31T12:00:00.000Z",
        "cleared_at": None,
        "acknowledged_by": None,
        "note": "",
        "shelved_until": None,
    }
    assert answer["trend"]["crossings"][0] == {
        "limit": "fault",
        "limit_percent": 3.0,
        "earliest": "2026-01-31T12:00:01.000Z",
        "likely": "2026-01-31T12:00:02.000Z",
        "latest": None,
    }


async def test_use_and_friction_are_told_once_they_are_known(scene, client):
    wear = (await client.get(f"{BASE}/wear")).json()
    assert (wear["use"], wear["stroke"], wear["friction"]["count"]) == (None, None, [])
    use = USE.model_copy(update={"since_time_ns": scene.now_ns})
    curve = FrictionCurve(speed_rad_s=(1.0,), torque_nm=(0.1,), first_torque_nm=(0.2,), count=(5,))
    scene.hear_health(use=use, friction=curve)
    wear = (await client.get(f"{BASE}/wear")).json()
    assert (wear["use"]["distance_m"], wear["use"]["since"]) == (4.5, "2026-01-31T12:00:00.000Z")
    assert wear["friction"]["first_torque_nm"] == [0.2]


async def test_traces_are_the_last_intervals_with_null_for_what_is_missing(scene, client):
    for tenth in range(30):
        torque = float("nan") if tenth == 29 else 0.1 * tenth
        scene.state.on_feature("X", scene.header(), _feature(torque_mean_nm=torque))
        scene.wait(0.1)
    answer = (await client.get(f"{BASE}/live", params={"duration": 1.05})).json()
    assert answer["torque_nm"] == pytest.approx([*np.arange(2.0, 2.85, 0.1), None])
    assert len(answer["time_s"]) == 10
    assert answer["channels"][0] == {"channel": "torque", "state": "ok", "good_share": 1.0}


async def test_the_log_is_read_page_by_page_from_the_newest(scene, client):
    x, y, service = (scene.hear_event(axis, axis) for axis in ("X", "Y", ""))

    async def ids(**params: object) -> list[int]:
        answer = (await client.get("/api/v1/log", params=params)).json()
        return [each["id"] for each in answer["items"]]

    assert await ids() == [service, y, x]
    assert await ids(axis="X") == [service, x]
    assert await ids(kind="note") == []
    assert await ids(kind=["note", "condition_changed"], limit=1) == [service]
    first = (await client.get("/api/v1/log", params={"axis": "X", "limit": 1})).json()
    last = (await client.get(first["next"])).json()
    assert ([each["id"] for each in last["items"]], last["next"]) == ([x], None)
    scene.wait(60.0)
    after = scene.now_ns / 1e9 - 30.0
    assert await ids(**{"from": after}) == []
    assert await ids(to=after) == [service, y, x]
    assert (await client.get("/api/v1/log?axis=Q")).status_code == 404


async def test_history_can_be_taken_along(scene, client):
    values = np.random.default_rng(1).uniform(3.0, 7.0, 50)
    for value in values.tolist():
        scene.hear_preload(preload_percent=value)
        scene.wait(1.0)
    answer = await client.get(f"{BASE}/history", params={"format": "parquet"})
    assert "attachment" in answer.headers["content-disposition"]
    table = pq.read_table(io.BytesIO(answer.content))
    np.testing.assert_array_equal(table["preload_percent"].to_numpy(), values)
    assert set(table["axis"].to_pylist()) == {"X"}
    text = (await client.get(f"{BASE}/history", params={"format": "csv"})).text
    assert len(text.splitlines()) == 51
    for wrong in ({"format": "xlsx"}, {"format": "csv", "step": 1.0}):
        assert (await client.get(f"{BASE}/history", params=wrong)).status_code == 422


NOTE = {"action": "note", "user": "Kim", "note": "greased"}
KEYS = {
    '"8e03978e-40d5-43dd-bc93-6894a57f9324"': "8e03978e-40d5-43dd-bc93-6894a57f9324",
    "bare": "bare",
    "": "",
    '""': None,
    '"half': None,
    "two words": None,
    "x" * 99: None,
    '"a\\"b"': None,
}


@pytest.mark.parametrize("given", KEYS)
async def test_a_key_is_passed_on_or_refused_by_name(given, client, sent):
    answer = await client.post(f"{BASE}/commands", json=NOTE, headers={"idempotency-key": given})
    if KEYS[given] is None:
        assert (answer.status_code, sent) == (422, [])
        assert "dempotency-key" in answer.json()["errors"][0]["parameter"]
    else:
        assert (answer.status_code, [each.key for _, each in sent]) == (202, [KEYS[given]])
