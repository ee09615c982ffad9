"""Jobs over HTTP: commands that end whatever happens, and what is left of them."""

import asyncio
import errno
import os
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, get_args

import httpx
import pytest

from edge_service import process
from edge_service.cli.entry import cli
from edge_service.config import DEFAULT_MACHINE
from edge_service.health.service_state import ServiceState
from edge_service.health.store.store import FILE_NAME, Store
from edge_service.http_api import guard, jobs
from edge_service.http_api.app import create_app
from edge_service.http_api.jobs import JobCommand, Jobs
from edge_service.http_api.recordings import Recordings
from edge_service.http_api.routes.work import MotionAnswer
from edge_service.recordings.reader import extent_of

from .conftest import client_of, foreign_recording

CHILD = """
import os, pathlib, signal, sys, time
words = sys.argv[1:]
out = pathlib.Path(words[words.index("--out") + 1])
kind = next(pathlib.Path(each).stem for each in words if each.endswith(".csv"))
say = lambda line: print(line, file=sys.stderr, flush=True)
say("edge-service diagnose: choosing causes, 40 %, 32 s")
if kind == "deaf": signal.signal(signal.SIGTERM, signal.SIG_IGN)
if kind == "parent" and os.fork() == 0: time.sleep(600)
if kind == "parent": say(str(os.getpid()))
if words[0] == "record":
    signal.signal(signal.SIGTERM, lambda *_: (out.write_text("time_s"), os._exit(0)))
    say("ready")
    signal.pause()
if kind in ("long", "deaf"): say("ready"); time.sleep(600)
if kind == "bad":
    print('{"error": {"detail": "bad.csv: no time_s", "exit_status": 2}}')
    sys.exit(2)
if kind == "killed": os.kill(os.getpid(), 9)
for name in ("report.html", "fingerprint.json", "diagnosis.json"): (out / name).write_text("{}")
print('{"verdict": "explained"}')
"""


class Scene:
    """The routes over jobs whose command is a small program; what it does is its trace's name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.store = Store(folder / FILE_NAME)
        kept = Recordings(folder / "recordings", 1 << 20, extent_of)
        slow = folder / "slow.toml"
        slow.write_text(DEFAULT_MACHINE.read_text().replace("]", "]\nmax_speed_rad_s = 200.0", 1))
        self.jobs = Jobs(self.store, folder / "jobs", kept, {"X": slow})
        motion = MotionAnswer(name="friction", purpose="", duration_s=1.0)
        app = create_app(
            ServiceState({"X": None}, 0),
            lambda: 0,
            jobs=self.jobs,
            recordings=kept,
            motions=lambda _axis: [motion],
        )
        self.client = client_of(app, "http://127.0.0.1/api/v1/", raise_app_exceptions=False)

    async def start(self, trace: str = "short", **more: Any) -> httpx.Response:
        body = {"command": "fingerprint", "axis": "X", "recordings": [f"{trace}.csv"]}
        if not (self.folder / "recordings" / f"{trace}.csv").exists():
            await self.client.put(f"recordings/{trace}.csv", content=b"time_s\n0\n")
        return await self.client.post("jobs", json=body | more)

    async def job(self, number: int = 1) -> dict[str, Any]:
        return (await self.client.get(f"jobs/{number}")).json()

    async def until(self, fits: Callable[[dict[str, Any]], bool], number: int = 1) -> Any:
        while not fits(job := await self.job(number)):
            await asyncio.sleep(0.01)
        return job

    async def ended(self, number: int = 1) -> dict[str, Any]:
        return await self.until(lambda job: job["state"] != "running", number)

    async def ready(self, number: int = 1) -> dict[str, Any]:
        return await self.until(lambda job: "ready" in job["lines"], number)

    async def close(self) -> None:
        await self.jobs.close()
        await self.client.aclose()
        self.store.close()


@pytest.fixture(autouse=True)
def small_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-S", "-c", CHILD))


@pytest.fixture
async def scene(tmp_path: Path) -> AsyncIterator[Scene]:
    scene = Scene(tmp_path)
    yield scene
    await scene.close()


async def test_a_job_runs_and_its_files_can_be_read(scene: Scene) -> None:
    answer = await scene.start()
    assert (answer.status_code, answer.headers["location"]) == (202, "/api/v1/jobs/1")
    job = await scene.ended()
    assert (job["state"], job["verdict"], job["share"]) == ("done", "explained", None)
    made = ["answer.json", "diagnosis.json", "fingerprint.json", "log.txt", "report.html"]
    assert job["files"] == made
    report = await scene.client.get("jobs/1/files/report.html")
    assert report.text == "{}"
    assert report.headers["content-security-policy"].startswith("sandbox;")
    assert (await scene.start(options={"baseline": 1})).status_code == 202
    listed = (await scene.client.get("jobs")).json()
    assert ([each["id"] for each in listed["items"]], listed["next"]) == ([2, 1], None)
    assert listed["items"][0]["options"]["baseline"] == 1


async def test_progress_is_read_from_the_lines_of_the_command(scene: Scene) -> None:
    await scene.start("long")
    await scene.ready()
    said = "edge-service diagnose: choosing causes, 40 %, 32 s\n"
    (scene.folder / "jobs" / "1" / "log.txt").write_text(said)
    job = await scene.job()
    assert (job["state"], job["stage"], job["share"]) == ("running", "choosing causes", 0.4)
    assert job["left_s"] == pytest.approx(48.0)


@pytest.mark.parametrize(
    ("trace", "said"),
    [("bad", "bad.csv: no time_s"), ("killed", "ended by signal 9; is there too little memory?")],
)
async def test_what_fails_says_why(scene: Scene, trace: str, said: str) -> None:
    await scene.start(trace)
    job = await scene.ended()
    assert job["state"] == "failed"
    assert said in (job["verdict"], job["lines"][-1])
    assert (await scene.client.get("jobs/1/files/report.html")).status_code == 404


async def test_a_third_job_waits_and_a_cancelled_one_makes_room(scene: Scene) -> None:
    assert [(await scene.start("long")).status_code for _ in range(3)] == [202, 202, 409]
    assert (await scene.client.delete("jobs/1")).json()["state"] == "cancelled"
    assert (await scene.client.delete("jobs/1")).status_code == 409
    assert (await scene.start()).status_code == 202
    assert (await scene.ended(3))["state"] == "done"


async def test_a_deaf_job_is_killed_with_what_it_started(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "PATIENCE_S", 0.0)
    await scene.start("deaf")
    await scene.ready()
    assert (await scene.client.delete("jobs/1")).json()["state"] == "cancelled"
    await scene.start("parent")
    group = int((await scene.ended(2))["lines"][-1])
    with pytest.raises(ProcessLookupError):
        for _ in range(1000):
            os.killpg(group, 0)
            await asyncio.sleep(0.01)


async def test_a_recording_that_is_stopped_keeps_what_there_is(scene: Scene) -> None:
    options = {"duration_s": 80.0}
    named = await scene.start(command="record", recordings=["test_X.csv"], options=options)
    assert named.status_code == 202
    await scene.ready()
    assert (await scene.client.delete("jobs/1")).json()["state"] == "done"
    assert (await scene.client.get("recordings/test_X.csv")).text == "time_s"


async def test_jobs_outlive_the_service_and_what_ran_is_interrupted(
    scene: Scene, tmp_path: Path
) -> None:
    await scene.start()
    before = await scene.ended()
    await scene.start("long")
    await scene.ready(2)
    again = Scene(tmp_path)  # the first was not closed: it was killed
    assert await again.job(1) == before
    assert (await again.job(2))["state"] == "interrupted"
    assert (await again.client.delete("jobs/2")).status_code == 409
    await again.start()
    assert (await again.ended(3))["state"] == "done"
    await again.close()
    await scene.close()
    assert (await Scene(tmp_path).job(2))["state"] == "interrupted"


async def test_the_oldest_jobs_make_room_and_a_damaged_row_is_left_out(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "MOST_KEPT", 2)
    for number in (1, 2, 3):
        await scene.start()
        await scene.ended(number)
    assert {path.name for path in (scene.folder / "jobs").iterdir()} == {"2", "3"}
    for listed in ([3, 2], [2]):
        assert [each["id"] for each in (await scene.client.get("jobs")).json()["items"]] == listed
        scene.store.write(lambda file: file.execute("UPDATE jobs SET body = '{' WHERE id = 3"))


async def test_recordings_and_jobs_are_read_page_by_page_from_the_newest(scene: Scene) -> None:
    for number, name in enumerate(("friction_X_20261121T081530Z.csv", "long.csv", "b.parquet"), 1):
        await scene.client.put(f"recordings/{name}", content=b"time_s,torque_command_nm\n2,0\n5,1")
        os.utime(scene.folder / "recordings" / name, ns=(number, number))
    first = (await scene.client.get("recordings?limit=2")).json()
    assert [each["name"] for each in first["items"]] == ["b.parquet", "long.csv"]
    last = (await scene.client.get(first["next"].removeprefix("/api/v1/"))).json()
    assert last == {
        "items": [
            {
                "name": "friction_X_20261121T081530Z.csv",
                "axis": "X",
                "bytes": 32,
                "from": "2026-11-21T08:15:30.000Z",
                "to": "2026-11-21T08:15:33.000Z",
                "rows": 2,
                "kind": "friction",
            }
        ],
        "next": None,
    }
    upload = first["items"][1]
    known = [upload[each] for each in ("axis", "from", "to", "rows", "kind")]
    assert known == [None, None, None, 2, "upload"]
    for _ in range(2):
        await scene.start("long")
    first = (await scene.client.get("jobs?limit=1")).json()
    last = (await scene.client.get(first["next"].removeprefix("/api/v1/"))).json()
    assert [each["id"] for page in (first, last) for each in page["items"]] == [2, 1]
    assert last["next"] is None


async def test_who_has_a_file_already_is_told_so(scene: Scene) -> None:
    await scene.start()
    await scene.ended()
    for path in ("recordings/short.csv", "jobs/1/files/report.html"):
        answer = await scene.client.get(path)
        assert answer.headers["cache-control"] == "private, max-age=3600"
        known = {"if-none-match": answer.headers["etag"]}
        assert (await scene.client.get(path, headers=known)).status_code == 304


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EAGAIN, errno.ENOMEM])
async def test_a_job_that_cannot_be_started_has_failed(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    async def refuse(*_line: str, **_how: object) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as refusing:
        refusing.setattr(asyncio, "create_subprocess_exec", refuse)
        answer = await scene.start()
    assert answer.status_code == 503
    assert os.strerror(number) in answer.json()["detail"]
    assert (await scene.job())["state"] == "failed"
    assert (await scene.start()).status_code == 202


async def test_what_is_not_there_or_not_whole_is_told(scene: Scene) -> None:
    for more, status in (
        ({"recordings": ["other.csv"]}, 404),
        ({"axis": "Q"}, 404),
        ({"options": {"baseline": 7}}, 404),
        ({"options": {"machine": 7}}, 404),
        ({"command": "adopt", "options": {"given": ["--out=/etc/passwd"]}}, 422),
        ({"command": "adopt", "options": {"given": ["--set=stroke_m=1\0"]}}, 422),
        ({"command": "adopt", "axis": "--out=x"}, 422),
        ({"recordings": []}, 422),
        ({"recordings": ["../edge.toml"]}, 422),
        ({"command": "record", "recordings": []}, 422),
        ({"command": "rm"}, 422),
        ({"options": {"jobs": 3}}, 422),
    ):
        assert (await scene.start(**more)).status_code == status, more
    assert (await scene.client.delete("jobs/7")).status_code == 404
    assert (await scene.client.get("jobs")).json()["items"] == []


@pytest.mark.slow
async def test_a_new_axis_is_read_as_its_owner_says_and_examined(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-m", "edge_service"))
    monkeypatch.setattr(process, "NICE", 0)
    (tmp_path / "recordings").mkdir()
    foreign_recording(tmp_path / "recordings" / "a.csv", 20.0)
    asked = {"axis": "W", "recordings": ["a.csv"]}
    given = ["--column=table_position_m=Soll [mm]:mm", "--torque-constant=1.2"]
    for number, options in ((1, {}), (2, {"given": given})):
        await scene.client.post("jobs", json=asked | {"command": "adopt", "options": options})
        assert (await scene.ended(number))["state"] == "done"
    read = [(await scene.client.get(f"jobs/{each}/files/answer.json")).json() for each in (1, 2)]
    taken = [[each["quantity"] for each in answer["columns"]] for answer in read]
    assert taken[0] == ["time_s", "other", "motor_angle_rad", "position_setpoint_m"]
    assert taken[1] == ["time_s", "current", "motor_angle_rad", "table_position_m"]
    assert {each["option"] for each in read[0]["unknown"]} == {"--torque-constant"}
    assert "'Soll [mm]' in mm (as given)" in {each["words"] for each in read[1]["understood"]}
    body = asked | {"command": "doctor", "options": {"machine": 2}}
    assert (await scene.client.post("jobs", json=body)).status_code == 202
    await scene.ended(3)
    examined = (await scene.client.get("jobs/3/files/answer.json")).json()
    verdicts = {each["name"]: each["verdict"] for each in examined["findings"]}
    assert (verdicts["torque"], verdicts["lead"]) == ("fits", "fits")
    assert "doubtful" not in verdicts.values()


async def test_every_command_is_one_of_the_command_line(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[tuple[str, ...]] = []

    async def note(*words: str, **_streams: object) -> None:
        started.append(words)
        raise OSError(errno.EAGAIN, "not here")

    monkeypatch.setattr(process, "started", note)
    for command in get_args(JobCommand):
        await scene.start(command=command, options={"duration_s": 5.0})
    assert [words[0] for words in started] == list(get_args(JobCommand))
    for name, *words in started:
        context = cli.make_context("edge-service", [name])
        found = cli.get_command(context, name)
        assert found is not None
        found.make_context(name, words, parent=context)


async def test_a_motion_is_written_by_its_command(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "PROGRAM", (sys.executable, "-m", "edge_service"))
    monkeypatch.setattr(process, "NICE", 0)  # beside other work it would never begin
    motion = await scene.client.get("axes/X/motions/friction?format=mpf")
    assert (motion.status_code, "; left out: friction, 3000 r/min" in motion.text) == (200, True)
    unknown = await scene.client.get("axes/X/motions/warp?format=csv")
    assert (unknown.status_code, "warp" in unknown.json()["detail"]) == (404, True)
    assert (await scene.client.get("axes/X/motions/friction?format=exe")).status_code == 422


@pytest.mark.parametrize(
    "name", ["..%2Fedge.toml", ".hidden.csv", "trace.exe", "a%0Ab.csv", "x" * 120 + ".csv"]
)
async def test_only_plain_names_of_traces_are_taken(scene: Scene, name: str) -> None:
    answer = await scene.client.put(f"recordings/{name}", content=b"1")
    assert answer.status_code in (404, 422)
    assert (await scene.client.get("recordings")).json() == {"items": [], "next": None}


async def test_upload_is_whole_or_not_at_all(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "RECORDING_BYTES", 50)

    async def endless() -> AsyncIterator[bytes]:
        while True:
            yield b"x" * 20

    for content, status in ((b"x" * 51, 413), (endless(), 413), (b"", 422)):
        answer = await scene.client.put("recordings/big.csv", content=content)
        assert answer.status_code == status
    assert list((scene.folder / "recordings").iterdir()) == []
