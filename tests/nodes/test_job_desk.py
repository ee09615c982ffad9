"""Recordings and jobs: kept whole, one at a time, cancelled for good."""

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from edge_service.cli.entry import cli
from edge_service.http_api import guard
from edge_service.http_api.jobs import JobKind
from edge_service.nodes.jobs.job_desk import JOB_COMMANDS

from .job_scene import JobScene, scene_in


@pytest.fixture
async def jobs(tmp_path: Path) -> AsyncIterator[JobScene]:
    async with scene_in(tmp_path) as jobs:
        yield jobs


async def test_a_job_runs_and_its_files_can_be_read(jobs):
    assert (await jobs.start()).status_code == 202
    job = await jobs.ended()
    assert (job["state"], job["lines"]) == ("done", ["working"])
    assert job["files"] == ["diagnosis.json", "fingerprint.json", "report.html"]
    report = await jobs.client.get("jobs/1/files/report.html")
    assert report.text == "<p>fine</p>"
    assert report.headers["content-security-policy"].startswith("sandbox;")
    assert (await jobs.start(baseline=1)).status_code == 202
    assert (await jobs.ended())["baseline"] == 1


async def test_bad_input_is_told_in_the_words_of_the_command(jobs):
    jobs.let("bad")
    await jobs.start()
    job = await jobs.ended()
    assert (job["state"], job["lines"][-1], job["files"]) == ("failed", "trace.csv: no time_s", [])
    assert (await jobs.client.get("jobs/1/files/report.html")).status_code == 404


async def test_one_job_at_a_time_and_a_cancelled_one_is_gone(jobs):
    jobs.let("long")
    await jobs.start()
    assert (await jobs.start()).status_code == 409
    cancelled = (await jobs.client.delete("jobs/1")).json()
    assert cancelled["state"] == "cancelled"
    process = jobs.desk._jobs[1].process
    assert process.returncode == -9
    assert (await jobs.client.delete("jobs/1")).status_code == 409
    jobs.let("short")
    assert (await jobs.start()).status_code == 202
    assert (await jobs.ended())["state"] == "done"


async def test_closing_ends_what_runs(jobs):
    jobs.let("long")
    await jobs.start()
    await asyncio.wait_for(jobs.desk.close(), 10.0)
    assert jobs.desk._jobs[1].process.returncode == -9


@pytest.mark.parametrize(
    "name", ["..%2Fedge.toml", ".hidden.csv", "trace.txt", "a%0Ab.csv", "x" * 120 + ".csv"]
)
async def test_only_plain_names_of_traces_are_taken(jobs, name):
    answer = await jobs.client.put(f"recordings/{name}", content=b"1")
    assert answer.status_code in (404, 422)
    assert [each.name for each in jobs.desk.recordings()] == ["trace.csv"]


async def test_an_upload_is_whole_or_not_at_all(jobs, monkeypatch):
    monkeypatch.setattr(guard, "RECORDING_BYTES", 50)
    assert (await jobs.client.put("recordings/big.csv", content=b"x" * 51)).status_code == 413

    async def endless() -> AsyncIterator[bytes]:
        while True:
            yield b"x" * 20

    assert (await jobs.client.put("recordings/big.csv", content=endless())).status_code == 413
    assert (await jobs.client.put("recordings/empty.csv", content=b"")).status_code == 422
    folder = jobs.desk.folder
    assert [path.name for path in folder.iterdir()] == ["trace.csv"]


async def test_what_is_not_there_is_told(jobs):
    for request in (
        jobs.start(recordings=["other.csv"]),
        jobs.start(axis="Q"),
        jobs.client.delete("recordings/other.csv"),
        jobs.client.delete("jobs/7"),
    ):
        assert (await request).status_code == 404
    assert (await jobs.start(baseline=7)).status_code == 404
    assert (await jobs.start(recordings=[])).status_code == 422


def test_commands_are_those_of_the_command_line(tmp_path):
    line = JOB_COMMANDS[JobKind.FINGERPRINT](
        Path("m.toml"), [Path("a.csv"), Path("b.csv")], tmp_path, tmp_path / "old"
    )
    assert line[1:4] == ["-m", "edge_service", "fingerprint"]
    assert line[4:] == [
        *("--machine", "m.toml", "--out", str(tmp_path), "a.csv", "b.csv"),
        *("--baseline", str(tmp_path / "old" / "fingerprint.json")),
    ]


def test_every_kind_of_job_has_its_command():
    assert set(JOB_COMMANDS) == set(JobKind)
    for kind, command in JOB_COMMANDS.items():
        words = command(Path("m.toml"), [Path("a.csv"), Path("b.csv")], Path("out"), None)[3:]
        context = cli.make_context("edge-service", words[:1])
        found = cli.get_command(context, str(kind))
        assert found is not None
        found.make_context(str(kind), words[1:], parent=context)


@pytest.mark.parametrize(
    "wrong",
    [{"recordings": ["trace.csv"]}, {"recordings": ["trace.csv"] * 2}, {"baseline": 1}],
)
async def test_a_comparison_needs_two_recordings_and_no_baseline(jobs, wrong):
    body = {"kind": "drift", "recordings": ["trace.csv", "later.csv"]} | wrong
    answer = await jobs.start(**body)
    assert answer.status_code == 422
    assert "drift" in answer.json()["detail"]


async def test_a_comparison_keeps_the_order_of_its_recordings(jobs):
    await jobs.client.put("recordings/later.csv", content=b"t")
    answer = await jobs.start(kind="drift", recordings=["trace.csv", "later.csv"])
    assert answer.status_code == 202
    job = await jobs.ended()
    assert (job["kind"], job["state"]) == ("drift", "done")
    assert job["recordings"] == ["trace.csv", "later.csv"]


async def test_a_diagnosis_is_asked_for_by_the_name_of_a_recording(jobs):
    answer = await jobs.client.post("axes/X/diagnose", json={"recordings": ["trace.csv"]})
    assert answer.status_code == 202
    assert answer.headers["location"] == "/api/v1/jobs/1"
    job = await jobs.ended()
    assert (job["kind"], job["recordings"], job["state"]) == ("diagnose", ["trace.csv"], "done")
    assert (await jobs.client.get("jobs/1")).json() == job
    newest = await jobs.client.get("axes/X/diagnosis")
    assert newest.json() == {"schema": "diagnosis/1"}


async def test_a_diagnosis_is_asked_for_with_the_trace_itself(jobs):
    kinds = {"text/csv": ".csv", "application/vnd.apache.parquet": ".parquet"}
    for kind, suffix in kinds.items():
        headers = {"content-type": kind}
        answer = await jobs.client.post("axes/X/diagnose", content=b"0\n", headers=headers)
        assert answer.status_code == 202
        (name,) = (await jobs.ended())["recordings"]
        assert name.startswith("upload_X_")
        assert name.endswith(suffix)
        listed = (await jobs.client.get("recordings")).json()["recordings"]
        assert name in [each["name"] for each in listed]


async def test_a_second_diagnosis_waits_for_the_first_or_its_end(jobs):
    jobs.let("long")
    body = {"recordings": ["trace.csv"]}
    assert (await jobs.client.post("axes/X/diagnose", json=body)).status_code == 202
    refused = await jobs.client.post("axes/X/diagnose", json=body)
    assert refused.status_code == 409
    assert refused.headers["content-type"] == "application/problem+json"
    assert (await jobs.client.get("axes/X/diagnosis")).status_code == 409
    assert (await jobs.client.delete("jobs/1")).json()["state"] == "cancelled"
    jobs.let("short")
    assert (await jobs.client.post("axes/X/diagnose", json=body)).status_code == 202
    await jobs.ended()


@pytest.mark.parametrize(
    ("content", "kind", "status"),
    [
        (b"", "application/json", 422),
        (b"{}", "application/json", 422),
        (b'{"recordings": []}', "application/json", 422),
        (b"[" * 5000, "application/json", 422),
        (b'{"recordings": ["none.csv"]}', "application/json", 404),
        (b'{"recordings": ["../edge.toml"]}', "application/json", 422),
        (b"", "text/csv", 422),
        (b"x", "image/png", 415),
    ],
)
async def test_what_is_no_request_for_a_diagnosis_is_refused(jobs, content, kind, status):
    headers = {"content-type": kind}
    answer = await jobs.client.post("axes/X/diagnose", content=content, headers=headers)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert [each.name for each in jobs.desk.recordings()] == ["trace.csv"]
    assert jobs.desk.jobs() == []


async def test_axes_without_a_diagnosis_say_so(jobs):
    assert (await jobs.client.get("axes/X/diagnosis")).status_code == 404
    assert (await jobs.client.get("axes/Q/diagnosis")).status_code == 404
    assert (await jobs.client.get("jobs/3")).status_code == 404
