"""A machine file brought up to date: what has changed, what it is worth, and no fault in it."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import DEFAULT_MACHINE, load_config, load_machine
from edge_service.messages.samples import TORQUE
from edge_service.nodes.service import reread
from edge_service.offline.recordings import read_recording
from edge_service.offline.simulate import SimulationSettings, simulate
from edge_service.recordings.writer import TraceWriter
from tests.nodes.conftest import once, served

BENCH = load_machine(DEFAULT_MACHINE)
CHANGE = ("viscous_error:change_nm_s_per_rad=0.004",)
PRODUCTION = SimulationSettings(duration_s=120.0, seed=5)


@pytest.fixture
def trace(tmp_path: Path, monkeypatch) -> Path:
    """Place of a recording beside the bench's machine file, `m.toml`."""
    monkeypatch.chdir(tmp_path)
    Path("m.toml").write_text(DEFAULT_MACHINE.read_text("utf-8"), "utf-8")
    return Path("later.csv")


def updated(capsys: pytest.CaptureFixture[str]) -> tuple[int, dict]:
    capsys.readouterr()
    status = main(["update", "later.csv", "--machine", "m.toml", "--json"])
    return status, json.loads(capsys.readouterr().out)


@pytest.mark.slow
def test_what_has_changed_goes_into_a_dated_copy(trace: Path, capsys) -> None:
    simulate(BENCH, replace(PRODUCTION, effects=CHANGE), trace)
    status, told = updated(capsys)
    assert status == 0
    (change,) = (each for each in told["changes"] if each["parameter"].startswith("viscous_error"))
    assert change["old"] == 0.0
    assert change["low"] <= 0.004 <= change["high"]
    assert told["gap"]["after"]["torque_nm"] < 0.3 * told["gap"]["before"]["torque_nm"]
    assert Path("m.toml").read_text("utf-8") == DEFAULT_MACHINE.read_text("utf-8")
    assert Path(told["out"]).read_text("utf-8").startswith("# Made by `edge-service update` at ")
    assert "viscous_error" in {each.name for each in load_machine(Path(told["out"])).effects}
    status, refused = updated(capsys)
    assert (status, "is there already" in refused["error"]["detail"]) == (2, True)


@pytest.mark.slow
@pytest.mark.parametrize("lacks", ["nothing", "preload", "torque"])
def test_a_lost_preload_is_never_learned(lacks: str, trace: Path, capsys) -> None:
    """Less friction without a data sheet, or no torque at all, may be one."""
    simulate(BENCH, replace(PRODUCTION, preload_percent=4.0), trace)
    if lacks == "preload":
        lines = Path("m.toml").read_text("utf-8").splitlines(keepends=True)
        Path("m.toml").write_text("".join(x for x in lines if not x.startswith("preload_n")))
    if lacks == "torque":
        frame = read_recording(BENCH, trace)
        channels = {name: each for name, each in frame.channels.items() if name != TORQUE}
        with TraceWriter(trace, tuple(channels)) as writer:
            writer.write(replace(frame, channels=channels))
    status, told = updated(capsys)
    assert (status, told["out"]) == (1, None)
    assert told["withheld"]
    assert not any(each["parameter"].startswith("drag_error") for each in told["changes"])
    assert {path.name for path in Path().iterdir()} == {"m.toml", "later.csv"}


def test_a_recording_without_a_block_to_hold_out_is_one_line(trace: Path, capsys) -> None:
    simulate(BENCH, replace(PRODUCTION, duration_s=20.0), trace)
    status, told = updated(capsys)
    assert (status, told["error"]["detail"]) == (2, "later.csv: too short; expected 45 s or more")


@pytest.mark.slow
async def test_a_service_takes_what_a_job_has_found_and_its_other_axis_goes_on(trace: Path) -> None:
    simulate(BENCH, replace(PRODUCTION, effects=CHANGE), trace)
    axis = '[[axes]]\nname = "{}"\n{}[axes.settings]\nscenario = "healthy"\n'
    tables = '[bus]\nendpoint = "tcp/127.0.0.1:0"\n[http]\nport = 0\n[store]\nfolder = "state"\n'
    place = Path("edge.toml")
    place.write_text(tables + axis.format("X", 'machine = "m.toml"\n') + axis.format("Y", ""))
    async with served(load_config(place)) as (service, client):
        await client.put("api/v1/recordings/later.csv", content=trace.read_bytes())
        asked = {"command": "update", "axis": "X", "recordings": ["later.csv"]}
        assert (await client.post("api/v1/jobs", json=asked)).status_code == 202
        job = await once(client, "jobs/1", lambda job: job["state"] != "running" and job, 300.0)
        assert (job["state"], "updated.toml: written" in job["verdict"]) == ("done", True)
        made = await client.get("api/v1/jobs/1/files/updated.toml")
        Path("m.toml").write_bytes(made.content)
        before = [(await client.get(f"api/v1/axes/{each}/preload")).json() for each in "XY"]
        x, y = (each["data_used_s"] for each in before)
        reread(service.context, lambda: load_config(place))
        assert "viscous_error" in {each.name for each in service.context.machines["X"].effects}
        await once(client, "axes/X/preload", lambda now: 0.0 < now["data_used_s"] < x)
        other = await once(client, "axes/Y/preload", lambda now: now["data_used_s"] != y and now)
        assert other["data_used_s"] > y
