"""From the drive to the answer: the whole service in one process and in several."""

import asyncio
import json
import shutil
import sys
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from edge_service import __version__
from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings
from edge_service.clock import now_ns
from edge_service.command_answer import LISTENER
from edge_service.config import DEFAULT_MACHINE, ConfigError, EdgeConfig, load_config, load_machine
from edge_service.config_tables import StoreConfig
from edge_service.downsample.vibration import MOST_SENSORS
from edge_service.health.store.store import FILE_NAME
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.health import Command, ComponentStatus
from edge_service.messages.samples import ANGLE, TORQUE, SampleFrame, Waveform
from edge_service.messages.topics import COMMAND, FEAT, HEALTH, OUTCOME, PRELOAD, RAW, STATUS, WAVE
from edge_service.nodes.context import NodeContext, header
from edge_service.nodes.record_node import record_axis
from edge_service.nodes.service import PIPELINE, reread, run_nodes
from edge_service.nodes.stub_node import make_stub, stub_axis
from edge_service.offline.estimate import OfflineEstimate
from edge_service.offline.replay import replay_trace
from edge_service.recordings.reader import open_trace, read_trace
from tests.programs import serving

from ..messages.examples import estimate_of
from .conftest import PATIENCE_S, config_of, done, once, reported, running, served, until

HEALTHY = {"scenario": "healthy", "speed": 20.0}
TRUTH_PERCENT = 100.0 * 510.0 / 7450.0
NOTES = {"axis": "X", "kind": "note"}
NOTE = {"action": "note", "user": "Kim", "note": "greased"}
PATH = "api/v1/axes/X/commands"


async def test_the_answer_follows_the_simulated_drive() -> None:
    async with served(config_of("simulated", HEALTHY)) as (_, client):

        def settled(now: Any) -> Any:
            tight = now["high"] and now["high"] - now["low"] < 2.0
            return tight and now["condition"] == "NORMAL" and now

        preload = await once(client, "axes/X/preload", settled)
        assert preload["status"] == "estimated"
        assert preload["low"] <= TRUTH_PERCENT <= preload["high"]
        assert abs(preload["preload_percent"] - TRUTH_PERCENT) < 0.6
        assert preload["preload_n"] == pytest.approx(preload["preload_percent"] * 74.5)
        assert preload["age_s"] < 2.0
        assert (await client.get("readyz")).status_code == 200
        assert (
            'edge_service_preload_rating_ratio{axis="X",bound="value"}'
            in (await client.get("metrics")).text
        )
        assert (await client.get("api/v1/axes")).json()["axes"][0]["axis"] == "X"


async def test_when_the_drive_falls_silent_nothing_stale_is_shown() -> None:
    config = config_of("simulated", HEALTHY)
    others: tuple[str, ...] = ("http", "health", "estimate", "downsample")
    async with served(config, others) as (service, client):
        stop = asyncio.Event()
        drive = asyncio.create_task(run_nodes(NodeContext(config, service.bus), ("acquire",), stop))
        is_there = lambda now: now["status"] == "estimated" and now  # noqa: E731
        before = await once(client, "axes/X/preload", is_there)
        stop.set()
        await drive
        after = await once(client, "axes/X/preload", lambda now: not is_there(now) and now)
        numbers = ("preload_percent", "low", "high", "preload_n", "drag_torque_nm")
        assert [after[name] for name in numbers] == [None] * 5
        assert after["condition"] == "UNAVAILABLE"
        assert after["reasons"]
        assert after["measured_at"] >= before["measured_at"]
        ready = await client.get("readyz")
        assert ready.status_code == 503
        assert ready.json()["reasons"]


async def test_each_pass_of_a_looped_recording_is_a_session_and_no_fault(trace_path: Path) -> None:
    config = config_of("replay", {"path": str(trace_path), "speed": 20.0, "loop": True})

    def passed(health: dict[str, Any]) -> Any:
        is_third = any(each["counters"].get("restarts", 0) > 1 for each in health["components"])
        return is_third and health["status"] == "estimated" and health

    async with served(config) as (_, client):
        assert (await once(client, "axes/X/health", passed))["data_faults"] == {}
        log = (await client.get("api/v1/log?kind=data_fault")).json()
        assert log["items"] == []


async def test_a_replay_gives_the_bytes_of_the_offline_run(trace_path: Path) -> None:
    config = config_of("replay", {"path": str(trace_path), "speed": 0.0})
    with open_trace(trace_path) as frames:
        estimate = OfflineEstimate(load_machine(DEFAULT_MACHINE), config.estimator)
        offline = [each.model_dump_json() for each in estimate.estimates(frames)]
    async with running(config, until_sources_end=True) as service:
        subscriber = service.bus.subscribe(config.keys.key("X", PRELOAD), PRELOAD)
        await asyncio.wait_for(asyncio.shield(service.task), 60.0)
        subscriber.close()
        heard = [(head.source_time_ns, each) async for _, head, each in subscriber]
    assert len(offline) == 199
    assert [each.model_dump_json() for _, each in heard] == offline
    assert [at_ns for at_ns, _ in heard] == sorted(at_ns for at_ns, _ in heard)


@pytest.mark.slow
async def test_nodes_on_sessions_of_their_own_work_alike(trace_path: Path, tmp_path: Path) -> None:
    config = config_of(
        "replay",
        {"path": str(trace_path), "speed": 50.0},
        outputs={
            "opcua": {"endpoint": "opc.tcp://127.0.0.1:0"},
            "mtconnect": {"endpoint": "tcp://127.0.0.1:0"},
            "mqtt": {"url": "mqtt://127.0.0.1:1"},
        },
    )
    router = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", read_only=False))
    there = BusSettings(router.endpoint, "client")
    names = (*PIPELINE, *config.outputs)
    buses = [await Bus.open(there) for _ in names]
    reader = await Bus.open(there)
    stop = asyncio.Event()
    reports = reader.subscribe(config.keys.all_components(STATUS), STATUS)
    healths = reader.subscribe(config.keys.all_axes(HEALTH), HEALTH)
    subscriber = reader.subscribe(config.keys.all_axes(PRELOAD), PRELOAD)
    try:
        tasks = [
            asyncio.create_task(run_nodes(NodeContext(config, bus), (name,), stop))
            for name, bus in zip(names, buses, strict=True)
        ]
        async with asyncio.timeout(60.0):
            heard = aiter(subscriber)
            axis, _, estimate = await anext(heard)
            while estimate.status is not EstimateStatus.ESTIMATED:
                axis, _, estimate = await anext(heard)
            await anext(aiter(healths))
            unheard = set(names)
            while unheard:
                _, _, report = await anext(aiter(reports))
                unheard -= {report.component}
        assert axis == "X"
        stop.set()
        await asyncio.gather(*tasks)
    finally:
        for bus in (*buses, reader, router):
            await bus.close()


async def test_replay_tells_last_answer_and_keeps_nothing(trace_path: Path, tmp_path: Path) -> None:
    addresses: list[str] = []
    config = config_of("simulated", {}, store=StoreConfig(folder=tmp_path / "state"))
    answer = await replay_trace(
        config, trace_path, DEFAULT_MACHINE, 0.0, hold=False, announce=addresses.append
    )
    lines = answer.words.splitlines()
    assert addresses[0].startswith("http://127.0.0.1:")
    assert lines[0].startswith("axis X: 199 estimates, status estimated at 19.9 s")
    assert lines[1].startswith("preload ")
    assert not (tmp_path / "state").exists()


async def test_a_faulty_recording_is_survived_and_told(trace_path: Path, tmp_path: Path) -> None:
    lines = trace_path.read_text().splitlines()
    faulty = [
        *lines[:3000],
        lines[2999],
        *lines[3000:6000],
        ",".join(["6.0", *["nan"] * (lines[0].count(",") - 1), ""]),
        *lines[6200:9000],
        *lines[8000:8500],
        *lines[9000:],
        "20.0,1",
    ]
    path = tmp_path / "faulty.csv"
    path.write_text("\n".join(faulty))
    config = config_of("replay", {"path": str(path), "speed": 0.0})
    async with running(config, until_sources_end=True) as service:
        reports = service.bus.subscribe(config.keys.all_components(STATUS), STATUS)
        subscriber = service.bus.subscribe(config.keys.key("X", PRELOAD), PRELOAD)
        await asyncio.wait_for(asyncio.shield(service.task), 60.0)
        subscriber.close()
        reports.close()
        last = [estimate async for _, _, estimate in subscriber][-1]
        counters: dict[str, int] = {}
        async for _, _, report in reports:
            counters |= report.counters
    assert last.status is EstimateStatus.ESTIMATED
    assert last.low is not None
    assert last.high is not None
    assert last.low <= TRUTH_PERCENT <= last.high
    assert counters["fault_repeat"] >= 1
    assert counters["fault_gap"] >= 1
    assert counters["fault_time_backwards"] >= 1


async def test_an_axis_that_begins_anew_meets_nothing_of_its_clock_before() -> None:
    times_s = np.arange(1000) / 1000.0 + np.array([[101.0], [0.0]])
    old, new = (SampleFrame(t, {TORQUE: np.full(1000, 0.2), ANGLE: 10.0 * t}) for t in times_s)
    async with running(config_of("simulated", HEALTHY), ("downsample",)) as service:
        context, heard = service.context, service.context.subscribe(FEAT)
        await reported(service, "downsample", ComponentStatus.OK)
        context.publisher("X", RAW).publish(old, now_ns())
        context.renew(context.config.axes[0], context.machines["X"])
        context.publisher("X", RAW).publish(new, now_ns())
        async with asyncio.timeout(60.0):
            assert (await anext(aiter(heard)))[2].time_s < 50.0


async def test_a_recording_of_bus_is_what_was_published(trace_path: Path, tmp_path: Path) -> None:
    config = config_of("replay", {"path": str(trace_path), "speed": 20.0, "loop": True})
    async with running(config, ("acquire",)) as service:
        there = config.model_copy(
            update={"bus": config.bus.model_copy(update={"endpoint": service.bus.endpoint})}
        )
        out = tmp_path / "recorded.csv"
        said: list[str] = []
        LISTENER.set(said.append)
        recording = record_axis(there, "X", out, 2.0)
        rows, lost = await asyncio.wait_for(recording, 60.0)
    recorded, original = read_trace(out), read_trace(trace_path)
    assert lost == 0
    assert "recording axis X: 50 %" in said
    assert rows == len(recorded) == 2000
    first = int(np.searchsorted(original.time_s, recorded.time_s[0] - 1e-9))
    if first + 2000 <= len(original):  # else the loop began again in between
        expected = original.channels[ANGLE][first : first + 2000]
        np.testing.assert_array_equal(recorded.channels[ANGLE], expected)
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.slow
def test_the_command_serves_and_stops_cleanly_in_processes_of_their_own(tmp_path: Path) -> None:
    line = (sys.executable, "-m", "edge_service", "run", "--port", "0", "--bus", "tcp/127.0.0.1:0")
    with serving(*line, folder=tmp_path, PYTHONPATH=str(Path(__file__).parents[2])) as said:
        first = said.readline()
        assert first.startswith("edge-service: serving http://127.0.0.1:")
        more = f"version {__version__}, state in memory alone; Ctrl-C ends it"
        assert said.readline() == f"edge-service: {more}\n"
        assert httpx.get(first.split()[2] + "healthz").status_code == 200


async def test_a_file_that_is_read_again_renews_only_the_axes_that_it_changed(
    tmp_path: Path, bus: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    def written(x_percent: float, port: int, driver: str = "simulated") -> EdgeConfig:
        shutil.copy(DEFAULT_MACHINE, tmp_path / "machine.toml")
        path = tmp_path / "edge.toml"
        tables = [
            f'[[axes]]\nname = "{name}"\nmachine = "machine.toml"\ndriver = "{driver}"\n'
            f"[axes.settings]\nstart_percent = {percent}\n"
            for name, percent in (("X", x_percent), ("Y", 6.0))
        ]
        path.write_text(f"[http]\nport = {port}\n" + "\n".join(tables))
        return load_config(path)

    context, stop = NodeContext(written(6.0, 1), bus), asyncio.Event()
    renewed: list[str] = []
    context.renewals.append(renewed.append)
    reports = bus.subscribe(context.config.keys.all_components(STATUS), STATUS, depth=4096)
    running_nodes = asyncio.create_task(run_nodes(context, ("acquire", "health"), stop))

    async def heard(axis: str, status: ComponentStatus) -> None:
        async with asyncio.timeout(60.0):
            async for _, _, report in reports:
                if (report.axis, report.status) == (axis, status):
                    return

    try:
        await heard("Y", ComponentStatus.OK)
        await heard("X", ComponentStatus.OK)
        reread(context, lambda: written(6.0, 1))
        assert renewed == []
        reread(context, lambda: written(5.0, 2))
        assert renewed == ["X"]
        assert context.config.axes[0].settings == {"start_percent": 5.0}
        await heard("X", ComponentStatus.STARTING)
        await heard("X", ComponentStatus.OK)
        reread(context, lambda: written(5.0, 1, "none"))
        assert renewed == ["X"]
    finally:
        stop.set()
        await running_nodes
    restart, refused = (each for each in caplog.messages if "axes" in each)
    assert restart == "what has changed beside the axes takes effect after a restart"
    assert "axes.X.driver: no driver 'none'" in refused


async def test_a_store_that_cannot_be_read_is_waited_for_said_and_left_as_it_is(
    tmp_path: Path,
) -> None:
    """Rights of another user after a restore: latched alarms are not forgotten."""
    config = config_of("simulated", HEALTHY, store=StoreConfig(folder=tmp_path))
    path, elsewhere, nodes = tmp_path / FILE_NAME, tmp_path / "elsewhere", ("http", "health")
    note = {"action": "note", "user": "Kim", "note": "greased"}
    async with served(config, nodes) as (_, client):
        await done(client, "api/v1/axes/X/commands", note, key="a")
    path.rename(elsewhere)
    path.mkdir()
    async with served(config, nodes) as (_, client):
        for page in ("readyz", "api/v1/health", "api/v1/log"):
            answer = await client.get(page)
            assert answer.status_code == 503
            assert "Is a directory" in answer.json()["detail"]
        assert (await client.get("healthz")).status_code == 200
        path.rmdir()
        elsewhere.rename(path)
        (found,) = await once(client, "log?axis=X&kind=note", lambda log: log["items"])
        assert found["text"] == "greased (Kim)"
        again = await done(client, "api/v1/axes/X/commands", note, key="a")
        assert again.json()["outcome"] == "greased (Kim)"
        assert len((await client.get("api/v1/log", params=NOTES)).json()["items"]) == 1
    assert not list(tmp_path.glob("*damaged*"))


async def test_who_asks_on_the_bus_is_answered_as_by_http() -> None:
    config = config_of("simulated", HEALTHY)
    async with served(config, ("http",)) as (service, client):
        publisher = service.bus.publisher(config.keys.key("X", PRELOAD), PRELOAD, "X")

        async def asked(selector: str) -> Any:
            key = f"{config.keys.root}/X/history?{selector}"
            answer = await service.bus.ask(key, None, 10.0)
            return json.loads(answer or b"null")

        async def kept() -> Any:
            publisher.publish(estimate_of(), now_ns())
            return (await client.get("api/v1/axes/X/history")).json()["buckets"]

        (first, *_) = await until(kept)
        span = {"from": first["time"], "to": "2100-01-01T00:00:00Z", "step": "86400000"}
        by_http = (await client.get("api/v1/axes/X/history", params=span)).json()
        by_bus = await asked(";".join(f"{name}={value}" for name, value in span.items()))
        for each in (by_http, by_bus):
            assert each["axis"] == "X"
            assert [bucket["time"] for bucket in each["buckets"]] == [first["time"]]
        assert set(by_http) == set(by_bus)
        assert "more than 5000" in (await asked("from=0;step=1"))["detail"]
        assert "speed: unknown" in (await asked("speed=1"))["detail"]


@pytest.mark.slow
async def test_a_damaged_raceway_is_heard_at_the_ball_pass(tmp_path: Path) -> None:
    balls = "[axis]\nball_diameter_m = 3.175e-3\nball_circle_m = 0.0206\n"
    machine = tmp_path / "machine.toml"
    machine.write_text(DEFAULT_MACHINE.read_text().replace("[axis]\n", balls, 1))
    settings = {"scenario": "healthy", "speed": 4.0, "accelerometer_hz": 1e4, "raceway_damage": 8.0}
    config = config_of("simulated", settings, machine)
    async with running(config, ("downsample", "acquire")) as service:
        features = service.bus.subscribe(config.keys.all_axes(FEAT), FEAT)
        async with asyncio.timeout(120.0):
            async for _, _, block in features:
                found = {name: (value, unit) for name, value, unit in block.vibration}
                if found:
                    assert found["nut_acceleration.rms"][1] == "m/s^2"
                peak, _ = found.get("nut_acceleration.envelope_ball_pass_nut", (0.0, ""))
                floor, _ = found.get("nut_acceleration.envelope_ball_pass_nut_floor", (1.0, ""))
                if peak > 4.0 * floor:
                    break


async def test_a_surplus_sensor_is_counted() -> None:
    config = config_of("simulated", {})
    key = config.keys.key("X", WAVE)
    async with running(config, ("downsample",)) as service:
        waves = service.bus.publisher(key, WAVE, "X")
        async with asyncio.timeout(60.0):
            while not service.bus.refused()["wave", "surplus"]:
                for number in range(MOST_SENSORS + 1):
                    waves.publish(Waveform(str(number), "V", 0.0, 1e-4, np.zeros(10)), 1)
                await asyncio.sleep(0.01)


async def test_without_a_monitor_no_command_is_accepted_and_none_is_lost(tmp_path: Path) -> None:
    config = config_of("simulated", HEALTHY, store=StoreConfig(folder=tmp_path))
    alone: tuple[str, ...] = ("http",)
    async with served(config, alone) as (_, client):
        answer = await client.post(PATH, json=NOTE)
        assert answer.status_code == 503
        assert "does not answer" in answer.json()["detail"]
        assert (await client.get("api/v1/log")).json()["items"] == []


@pytest.mark.parametrize("folder", [True, False], ids=["on disk", "in memory"])
async def test_a_command_is_answered_when_it_is_done(folder: bool, tmp_path: Path) -> None:
    store = StoreConfig(folder=tmp_path if folder else None)
    async with served(config_of("simulated", HEALTHY, store=store)) as (_, client):
        assert (await done(client, PATH, NOTE, key="a")).json() == {"outcome": "greased (Kim)"}
        (note,) = (await client.get("api/v1/log?kind=note")).json()["items"]
        assert (note["text"], note["who"]) == ("greased (Kim)", "Kim")
        for action, more in (("acknowledge", {"occurrence": 1}), ("unshelve", {})):
            body = {"action": action, "alarm": "sudden_drop", "user": "Kim"}
            answer = await client.post(PATH, json=body | more)
            assert answer.status_code == 409, action
            assert "sudden_drop" in answer.json()["detail"]
        kept = (await client.get("api/v1/log?kind=command")).json()["items"]
        told = [(each["data"]["action"], each["who"], each["origin"]) for each in kept]
        refused = [each for each in told if each[0] != "note"]  # a busy disk refuses one at first
        assert refused == [(action, "Kim", "127.0.0.1") for action in ("unshelve", "acknowledge")]


async def test_a_command_with_a_key_is_done_once_however_it_comes(tmp_path: Path) -> None:
    """By HTTP and by the bus, with another start between."""
    config = config_of("simulated", HEALTHY, store=StoreConfig(folder=tmp_path))
    again, notes = {"idempotency-key": '"a"'}, []
    command = Command(action="note", user="Kim", note="greased", key="a")
    for _ in range(2):
        async with served(config) as (service, client):
            answer = await done(client, PATH, NOTE, key="a")
            asked = COMMAND.encode("X", header(), command)
            told = await service.bus.ask(config.keys.key("X", OUTCOME), asked, PATIENCE_S)
            assert told is not None and OUTCOME.decode(told)[2].message == "greased (Kim)"
            assert answer.json() == {"outcome": "greased (Kim)"}
            other = await client.post(PATH, json=NOTE | {"note": "oiled"}, headers=again)
            assert other.status_code == 422
            assert "another command" in other.json()["detail"]
            found = (await client.get("api/v1/log?kind=note&kind=command")).json()["items"]
            notes.append([each["text"] for each in found if "was refused" not in each["text"]])
    assert notes == [["greased (Kim)"]] * 2


STUBBED = config_of(
    "modbus",
    {
        "url": "modbus://127.0.0.1:1",
        "poll_groups": {"all": 0.02},
        "registers": [{"channel": "torque_command_nm", "address": 0}],
    },
)


async def test_a_stub_plays_the_samples_of_a_recording(tmp_path: Path) -> None:
    trace = tmp_path / "short.csv"
    time_s = np.arange(40) * 0.002
    rows = np.column_stack([time_s, np.sin(time_s), 3.0 * time_s])
    trace.write_text("time_s,torque_command_nm,motor_angle_rad\n")
    with trace.open("a") as file:
        np.savetxt(file, rows, delimiter=",")
    axis = stub_axis(STUBBED.axes[0], "healthy", trace, None)
    frames = [frame async for frame in axis.source]
    played = np.concatenate([frame.channels["torque_command_nm"] for frame in frames])
    np.testing.assert_allclose(played, rows[:, 1])


def test_a_recording_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--trace .*: no such file"):
        make_stub("modbus", STUBBED, None, "healthy", tmp_path / "none.csv")
