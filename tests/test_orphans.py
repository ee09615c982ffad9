"""A job does not outlive a service that is killed."""

import asyncio
import sys
from pathlib import Path

import pytest

PARENT = """
import asyncio
from edge_service.process import started

async def main():
    job = await started("run", "--port", "0", "--bus", "tcp/127.0.0.1:0", stdout=-1)
    await job.stdout.readline()
    print(job.pid, flush=True)
    await job.wait()

asyncio.run(main())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="prctl(2) is of Linux")
async def test_a_job_ends_with_the_service_that_was_killed() -> None:
    line = (sys.executable, "-W", "ignore", "-c", PARENT)
    parent = await asyncio.create_subprocess_exec(*line, stdout=asyncio.subprocess.PIPE)
    assert parent.stdout is not None
    async with asyncio.timeout(60.0):
        job = Path("/proc", (await parent.stdout.readline()).decode().strip())
        parent.kill()
        await parent.wait()
        while job.exists() and "Z" not in (job / "stat").read_text().rpartition(")")[2]:
            await asyncio.sleep(0.01)
