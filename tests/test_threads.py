"""Threads of one kind of work are bounded, and starve no other; a job ends with its service."""

import asyncio
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from edge_service.http_api.context import from_history
from edge_service.process import finished
from edge_service.threads import Threads

from .nodes.conftest import PATIENCE_S, until

HUNG = 40
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


@contextmanager
def hanging() -> Iterator[threading.Event]:
    """An event for which threads wait; they go on at the end."""
    go_on = threading.Event()
    try:
        yield go_on
    finally:
        go_on.set()


async def test_work_returns_or_raises() -> None:
    threads = Threads("test")
    assert await threads.run(divmod, 7, 2) == (3, 1)
    with pytest.raises(ZeroDivisionError):
        await threads.run(divmod, 7, 0)
    assert await threads.run(int, "11", base=2) == 3


async def test_no_more_threads_than_allowed() -> None:
    threads = Threads("test", 3)
    with hanging() as go_on:
        works = [asyncio.ensure_future(threads.run(go_on.wait)) for _ in range(10)]
        await until(lambda: threads._busy == 3)
        assert threads._alive == 3
        go_on.set()
        await asyncio.gather(*works)


async def test_who_ceases_to_wait_takes_back_what_was_not_begun() -> None:
    threads, begun = Threads("test"), []
    with hanging() as go_on:
        first = asyncio.ensure_future(threads.run(go_on.wait))
        await until(lambda: threads._busy == 1)
        second = asyncio.ensure_future(threads.run(begun.append, 2))
        await asyncio.sleep(0)
        first.cancel()
        second.cancel()
        await asyncio.gather(first, second, return_exceptions=True)
        assert threads._busy == 1  # nothing can end it
    await threads.run(begun.append, 3)
    assert begun == [3]


async def test_a_thread_without_work_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("edge_service.threads.IDLE_S", 0.0)
    threads = Threads("test", 2)
    for _ in range(50):
        assert await threads.run(int, 5) == 5
    await until(lambda: not threads._alive)


async def test_requests_that_hang_starve_no_driver(tmp_path: Path) -> None:
    with hanging() as go_on:
        asked = [asyncio.ensure_future(from_history(go_on.wait)) for _ in range(HUNG)]
        await asyncio.sleep(0)
        async with asyncio.timeout(PATIENCE_S):
            assert await Threads("replay X", 2).run(int, 7) == 7
            assert await asyncio.get_running_loop().getaddrinfo("127.0.0.1", 9)
        go_on.set()
        assert all(await asyncio.gather(*asked))


async def test_no_job_imports_from_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Others may write there."""
    (tmp_path / "edge_service.py").touch()
    monkeypatch.chdir(tmp_path)
    assert "edge-service" in (await finished("--version", limit_s=PATIENCE_S))[1]


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
