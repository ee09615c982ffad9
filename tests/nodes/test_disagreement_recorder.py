"""An axis that changes in mid-run is seen, said and kept: the right seconds, never too many."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from edge_service.config_tables import StoreConfig
from edge_service.messages.event import Event
from edge_service.messages.samples import SampleFrame
from edge_service.nodes.record_node import (
    AFTER_S,
    BEFORE_S,
    KEEP_S,
    MOST_KEPT,
    DisagreementRecorder,
)
from edge_service.recordings.reader import read_trace

from ..messages.examples import event_of
from .conftest import config_of, once, served

RATE_HZ = 100.0
CHANGES_S = 250.0
PATIENCE_S = 300.0


def name_of(number: int) -> str:
    return f"disagreement_X_20260101T00000{number}Z.parquet"


def event(since_s: float, name: str = name_of(1)) -> Event:
    return event_of(kind="model_disagrees", data={"recording": name, "since_s": since_s})


class Scene:
    def __init__(self, folder: Path) -> None:
        self.kept: list[tuple[str, str]] = []
        self.recorder = DisagreementRecorder(folder, self._take)
        self.now_s = 0.0

    async def _take(self, axis: str, name: str) -> None:
        self.kept.append((axis, name))

    async def run(self, seconds: float) -> None:
        """Let samples come, a second at a time."""
        writing = asyncio.create_task(self.recorder.run())
        for _ in range(round(seconds)):
            time_s = self.now_s + np.arange(RATE_HZ) / RATE_HZ
            self.recorder.follow("X", SampleFrame(time_s, {"torque_command_nm": time_s}))
            await self.recorder._ready.join()
            self.now_s += 1.0
        writing.cancel()


async def test_the_seconds_around_it_are_kept(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    await scene.run(100)
    scene.recorder.note(event(since_s=80.0))
    await scene.run(AFTER_S - 1.0)
    assert scene.kept == []
    await scene.run(2)
    assert scene.kept == [("X", name_of(1))]
    trace = read_trace(tmp_path / name_of(1))
    assert trace.time_s[0] == pytest.approx(80.0 - BEFORE_S)
    assert trace.time_s[-1] == pytest.approx(100.0 + AFTER_S, abs=0.1)
    np.testing.assert_allclose(np.diff(trace.time_s), 1.0 / RATE_HZ, rtol=1e-6)
    np.testing.assert_array_equal(trace.channels["torque_command_nm"], trace.time_s)


async def test_memory_holds_no_more_than_it_should(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    await scene.run(1000)
    scene.recorder.note(event(since_s=10.0))
    await scene.run(AFTER_S + 2.0)
    trace = read_trace(tmp_path / name_of(1))
    assert trace.time_s[0] == pytest.approx(1000.0 - KEEP_S, abs=1.0)


async def test_only_the_newest_stay(tmp_path: Path) -> None:
    (tmp_path / "other.csv").write_text("mine")
    scene = Scene(tmp_path)
    await scene.run(50)
    for number in range(MOST_KEPT + 1):
        scene.recorder.note(event(since_s=scene.now_s - 5.0, name=name_of(number)))
        await scene.run(AFTER_S + 2.0)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [*map(name_of, range(1, MOST_KEPT + 1)), "other.csv"]


async def test_a_recording_that_is_there_is_never_overwritten(tmp_path: Path) -> None:
    (tmp_path / name_of(1)).write_text("mine")
    scene = Scene(tmp_path)
    await scene.run(50)
    scene.recorder.note(event(since_s=45.0))
    await scene.run(AFTER_S + 5.0)
    assert scene.kept == []
    assert (tmp_path / name_of(1)).read_text() == "mine"


async def test_a_clock_that_begins_anew_ends_the_recording(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    await scene.run(60)
    scene.recorder.note(event(since_s=50.0))
    scene.now_s = 0.0
    await scene.run(AFTER_S + 70.0)
    assert (scene.kept, list(tmp_path.iterdir())) == ([], [])


async def test_a_folder_that_cannot_be_written_stops_nothing(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    scene = Scene(blocked)
    await scene.run(50)
    scene.recorder.note(event(since_s=45.0))
    await asyncio.wait_for(scene.run(AFTER_S + 5.0), 60.0)
    assert scene.kept == []


@pytest.mark.slow
async def test_what_begins_in_mid_run_is_seen_kept_and_named(tmp_path: Path) -> None:
    settings = {
        "scenario": "healthy",
        "speed": 6.0,
        "effects": [f"position_friction:excess_nm=0.15,from_s={CHANGES_S}"],
    }
    config = config_of("simulated", settings, store=StoreConfig(folder=tmp_path / "history"))
    async with served(config) as (_, client):
        name = await once(
            client, "axes/X/health", lambda h: (h["consistency"] or {}).get("recording"), PATIENCE_S
        )
        health = (await client.get("api/v1/axes/X/health")).json()
        assert health["consistency"]["state"] == "disagrees"
        raised = lambda h: "model" in [each["alarm"] for each in h["alarms"]]  # noqa: E731
        await once(client, "axes/X/health", raised, PATIENCE_S)
        log = (await client.get("api/v1/log?axis=X")).json()["items"]
        ours = [each for each in log if each.get("data", {}).get("recording") == name]
        told = {each["kind"]: each for each in ours}
        assert told["model_disagrees"]["data"]["since_s"] == pytest.approx(CHANGES_S, abs=15.0)
        assert "recording_kept" in told
        kept = (await client.get("api/v1/recordings")).json()["items"]
        assert name in [each["name"] for each in kept]
        asked = await client.post(
            "api/v1/jobs", json={"command": "diagnose", "axis": "X", "recordings": [name]}
        )
        assert asked.status_code == 202
        path = asked.headers["location"].removeprefix("/api/v1/")
        job = await once(client, path, lambda j: j["state"] != "running" and j, PATIENCE_S)
        assert job["state"] == "done", job["lines"]
        document = (await client.get(f"api/v1/{path}/files/diagnosis.json")).json()
        named = {each["name"]: each["probability"] for each in document["effects"]}
        assert named["position_friction"] > 0.9
        report = await client.get(f"api/v1/{path}/files/report.html")
        assert "Position friction" in report.text
