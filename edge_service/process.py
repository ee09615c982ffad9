"""Programs started beside the service: in the background, and ended with all that they started."""

import asyncio
import ctypes
import os
import signal
import sys
from contextlib import suppress
from typing import Any

PROGRAM = (sys.executable, "-m", "edge_service")
NICE = 10
PATIENCE_S = 5.0
"""Time that a program has to end by itself when it is asked to."""
_PR_SET_PDEATHSIG = 1
ENVIRONMENT = {
    "PYTHONSAFEPATH": "1",  # the current folder may be another's, and so its modules
    "EDGE_SERVICE_PROGRESS": "1",
}


async def started(
    *words: str, program: tuple[str, ...] = (), nice: int | None = None, **streams: Any
) -> asyncio.subprocess.Process:
    """Process of `edge-service WORDS...`, first to go where memory runs short. Raises OSError."""
    process = await asyncio.create_subprocess_exec(
        *(*(program or PROGRAM), *words),
        stdin=asyncio.subprocess.DEVNULL,
        start_new_session=True,
        env=os.environ | ENVIRONMENT,
        **streams,
    )
    with suppress(OSError):  # it has ended already, or this system knows no such thing
        os.setpriority(os.PRIO_PROCESS, process.pid, NICE if nice is None else nice)
        handle = os.open(f"/proc/{process.pid}/oom_score_adj", os.O_WRONLY)
        try:
            os.write(handle, b"1000")
        finally:
            os.close(handle)
    return process


def end_with_parent() -> None:
    """Let a process that `started` began end when its service is killed: prctl(2), on Linux."""
    if "EDGE_SERVICE_PROGRESS" in os.environ and sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


async def end(process: asyncio.subprocess.Process) -> None:
    """Ask a process and what it started to end, then kill them."""
    _signal(process, signal.SIGTERM)
    with suppress(TimeoutError):
        async with asyncio.timeout(PATIENCE_S):
            await process.wait()
    _signal(process, signal.SIGKILL)
    await process.wait()


async def finished(*words: str, limit_s: float, **more: Any) -> tuple[int, str]:
    """Exit status of `edge-service WORDS...` and the last line it said. OSError, TimeoutError."""
    process = await started(
        *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT, **more
    )
    try:
        async with asyncio.timeout(limit_s):
            said, _ = await process.communicate()
    finally:
        await end(process)
    return process.returncode or 0, said.decode(errors="replace").strip().rpartition("\n")[2]


def _signal(process: asyncio.subprocess.Process, number: signal.Signals) -> None:
    with suppress(ProcessLookupError):
        os.killpg(process.pid, number)
