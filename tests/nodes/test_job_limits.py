"""A job ends whatever it does: bounded in time, memory and words, and gone with the service."""

import asyncio
import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from edge_service.config import DEFAULT_MACHINE
from edge_service.config_tables import JobsConfig
from edge_service.http_api.jobs import JobBody, JobKind, JobState, RefusedError
from edge_service.limited_process import ProcessLimits, limited_command, why_it_ended
from edge_service.nodes.jobs.job_desk import ProcessJobDesk

from .job_scene import followed

BODY = JobBody(kind=JobKind.DIAGNOSE, axis="X", recordings=["a.csv"])


def _desk(folder: Path, code: str, **limits: float) -> ProcessJobDesk:
    (folder / "@recordings").mkdir(parents=True, exist_ok=True)
    (folder / "@recordings" / "a.csv").write_text("time_s\n")
    line = [sys.executable, "-S", "-c", code]
    commands = {kind: lambda *_: line for kind in JobKind}
    return ProcessJobDesk(folder, {"X": DEFAULT_MACHINE}, JobsConfig(**limits), commands)


async def _ended(desk: ProcessJobDesk):
    await desk.start(BODY)
    await followed(desk)
    (job,) = desk.jobs()
    desk.check_free()
    return job


@pytest.mark.parametrize(
    ("code", "limits", "said"),
    [
        ("import time; time.sleep(60)", {"minutes": 0.002}, "took more than 0.002 minutes"),
        ("while True: print('x' * 100)", {"minutes": 0.005}, "took more than"),
        ("while True: print('x', end='')", {"minutes": 0.005}, "took more than"),
        ("x = bytearray(900_000_000)", {"memory_mb": 600.0}, "MemoryError"),
        ("import os; os.abort()", {}, "ended by SIGABRT"),
        ("import os; os.kill(os.getpid(), 9)", {}, "ended by SIGKILL"),
        ("raise SystemExit('a.csv: no trace')", {}, "a.csv: no trace"),
        ("import os; print('x' * 10**6); os._exit(5)", {}, "x" * 100),
    ],
)
async def test_every_job_ends_with_words_and_frees_the_desk(tmp_path, code, limits, said):
    job = await _ended(_desk(tmp_path, code, **limits))
    assert job.state is JobState.FAILED
    assert said in job.lines[-1]
    assert max(map(len, job.lines)) <= 500


@pytest.mark.parametrize("number", [errno.EMFILE, errno.EAGAIN, errno.ENOMEM, errno.EACCES])
async def test_a_job_that_cannot_be_started_has_failed(tmp_path, monkeypatch, number):
    async def refuse(*_line, **_how):
        raise OSError(number, os.strerror(number))

    desk = _desk(tmp_path, "")
    with monkeypatch.context() as refusing:
        refusing.setattr(asyncio, "create_subprocess_exec", refuse)
        with pytest.raises(RefusedError, match=os.strerror(number)) as refused:
            await desk.start(BODY)
    assert refused.value.status == 503
    (job,) = desk.jobs()
    assert (job.state, job.ended is None) == (JobState.FAILED, False)
    await desk.start(BODY)
    await followed(desk)


def _gone(pid: int) -> bool:
    """Tell whether a process has ended; waits for it a while."""
    status = Path(f"/proc/{pid}/stat")
    for _ in range(20_000):
        try:
            if ") Z " in status.read_text():
                return True
        except (FileNotFoundError, ProcessLookupError):
            return True
    return False


async def test_what_a_job_started_ends_with_it(tmp_path):
    code = "import os, time\nif os.fork(): os._exit(0)\nprint(os.getpid(), flush=True)\n"
    job = await _ended(_desk(tmp_path, code + "os.close(1); os.close(2); time.sleep(60)"))
    assert job.state is JobState.DONE
    assert _gone(int(job.lines[-1]))


SERVICE = """
import os, subprocess, sys
from edge_service.limited_process import *
line = [sys.executable, "-S", "-c", "import time; print(1, flush=True); time.sleep(60)"]
line = limited_command(line, ProcessLimits(1000.0, 60.0), dies_with_caller=True)
child = subprocess.Popen(line, stdout=subprocess.PIPE, start_new_session=True)
child.stdout.readline()
print(child.pid, flush=True)
os.kill(os.getpid(), 9)
"""


def test_a_job_dies_with_a_service_that_is_killed():
    service = subprocess.run([sys.executable, "-c", SERVICE], capture_output=True, check=False)
    assert service.returncode == -signal.SIGKILL, service.stderr
    assert _gone(int(service.stdout))


def test_a_job_whose_service_is_gone_already_does_not_begin():
    line = limited_command([sys.executable, "-c", "print(1)"], LIMITS, dies_with_caller=True)
    line[3] = "1"  # by now another process is the parent
    ended = subprocess.run(line, capture_output=True, check=False)
    assert (ended.returncode, ended.stdout) == (1, b"")


LIMITS = ProcessLimits(memory_mb=500.0, cpu_s=1.0)


def test_processor_time_is_bounded():
    line = limited_command(
        [sys.executable, "-c", "while True: pass"], LIMITS, dies_with_caller=True
    )
    ended = subprocess.run(line, capture_output=True, check=False)
    assert why_it_ended(ended.returncode, LIMITS) == "it took more than 1 s of processor time"


def test_a_program_that_is_not_there_is_one_line():
    line = limited_command(["/no/such"], LIMITS, dies_with_caller=False)
    ended = subprocess.run(line, capture_output=True, text=True, check=False)
    assert ended.stderr == "/no/such: cannot be run (No such file or directory)\n"
