"""Jobs outlive the service that ran them."""

import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from edge_service.http_api.jobs import JobState
from edge_service.nodes.jobs.job_records import known_jobs, save_job

from .job_scene import JobScene, scene_in


@pytest.fixture
async def jobs(tmp_path: Path) -> AsyncIterator[JobScene]:
    async with scene_in(tmp_path) as jobs:
        yield jobs


async def restarted(jobs: JobScene, folder: Path) -> JobScene:
    await jobs.desk.close()
    again = JobScene(folder)
    again.let("short")
    return again


async def test_jobs_and_their_files_are_there_after_a_restart(jobs, tmp_path):
    await jobs.start()
    before = await jobs.ended()
    again = await restarted(jobs, tmp_path)
    assert (await again.client.get("jobs")).json()["jobs"] == [before]
    assert (await again.client.get("jobs/1/files/report.html")).text == "<p>fine</p>"
    assert (await again.start(baseline=1)).json()["id"] == 2
    assert (await again.ended())["baseline"] == 1
    await again.close()


async def test_a_job_that_ran_when_the_service_died_has_failed(jobs, tmp_path):
    await jobs.start()
    await jobs.ended()
    (path,) = (tmp_path / "@jobs").glob("*.json")
    ((out, answer),) = known_jobs(path.parent)
    save_job(out, answer.model_copy(update={"state": JobState.RUNNING, "files": []}))
    again = JobScene(tmp_path)  # nobody closed the first: it was killed
    (job,) = (await again.client.get("jobs")).json()["jobs"]
    assert job["state"] == "failed"
    assert job["lines"][-1] == "the service stopped before the job was done"
    assert job["files"] == []
    await again.close()


async def test_a_damaged_record_is_left_out(jobs, tmp_path, caplog):
    await jobs.start()
    await jobs.ended()
    (path,) = (tmp_path / "@jobs").glob("*.json")
    (path.parent / "1.json").write_text("{")
    (path.parent / "2.json").write_text("[]")
    assert [answer.id for _, answer in known_jobs(path.parent)] == [1]
    assert caplog.text.count("not a valid record of a job") == 2


async def test_files_that_were_removed_by_hand_are_not_offered(jobs, tmp_path):
    await jobs.start()
    await jobs.ended()
    (out,) = (path for path in (tmp_path / "@jobs").iterdir() if path.is_dir())
    shutil.rmtree(out)
    again = await restarted(jobs, tmp_path)
    (job,) = (await again.client.get("jobs")).json()["jobs"]
    assert job["files"] == []
    assert (await again.client.get("jobs/1/files/report.html")).status_code == 404
    await again.close()


async def test_what_is_forgotten_stays_forgotten(jobs, tmp_path, monkeypatch):
    monkeypatch.setattr("edge_service.nodes.jobs.job_desk.MOST_JOBS", 1)
    for _ in range(2):
        await jobs.start()
        await jobs.ended()
    again = await restarted(jobs, tmp_path)
    assert [job["id"] for job in (await again.client.get("jobs")).json()["jobs"]] == [2]
    await again.close()
