"""Motions for a controller, and the axis recorded while it moves."""

import asyncio
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

from ... import exit_status
from ...clock import now_ns
from ...config import load_machine
from ...http_api.jobs import RefusedError
from ...http_api.routes.motions import (
    LiveRecordingAnswer,
    MotionAnswer,
    MotionForm,
    RecordingBody,
)
from ...limited_process import ProcessLimits, limited_command
from ...models.motions.registry import MOTIONS, MotionError, MotionLimits, motion_limits
from ...threads import Threads
from .live_recorder import LiveRecorder

_LIMITS = ProcessLimits(1000.0, 120.0)
_LONGEST_S = 120.0


class LiveMotionDesk:
    """See MotionDesk.

    Args:
        machines: machine file of each axis.
        recorder: records the axes.
    """

    def __init__(self, machines: dict[str, Path], recorder: LiveRecorder) -> None:
        self._machines, self._recorder = machines, recorder
        self._one = asyncio.Lock()
        self._threads = Threads("motion")

    def motions(self, axis: str) -> list[MotionAnswer]:
        """All motions that end by themselves."""
        limits = motion_limits(load_machine(self._machines[axis]))
        answers = [_answer(name, limits) for name in MOTIONS]
        return [each for each in answers if each.duration_s is not None or each.refused]

    async def motion(self, axis: str, name: str, form: MotionForm) -> bytes:
        """A motion's file, written in a process of its own; one at a time."""
        if name not in MOTIONS:
            raise RefusedError(404, f"there is no motion {name!r}")
        async with self._one:
            return await self._written(self._machines[axis], name, form)

    def live(self) -> LiveRecordingAnswer | None:
        """The recording that is being made."""
        return self._recorder.live()

    def record(self, axis: str, body: RecordingBody) -> LiveRecordingAnswer:
        """Begin to record; refused while another recording is made."""
        stamp = datetime.fromtimestamp(now_ns() / 1e9, UTC).strftime("%Y%m%dT%H%M%SZ")
        name = f"{body.motion or 'live'}_{axis}_{stamp}.parquet"
        return self._recorder.start(axis, name, body.seconds)

    def stop(self, axis: str) -> None:
        """End a recording early, and keep what there is."""
        self._recorder.stop(axis)

    async def _written(self, machine: Path, name: str, form: MotionForm) -> bytes:
        with tempfile.TemporaryDirectory(prefix="edge-motion-") as folder:
            out = Path(folder) / f"{name}.{form.value}"
            line = [sys.executable, "-m", "edge_service", "motion", name]
            line += ["--machine", str(machine), "--out", str(out)]
            status, said = await _run(line)
            if status != exit_status.DONE:
                raise RefusedError(409, said or f"the motion cannot be written (status {status})")
            return await self._threads.run(out.read_bytes)


def _answer(name: str, limits: MotionLimits) -> MotionAnswer:
    motion = MOTIONS[name]
    duration_s, refused = None, None
    try:
        duration_s = motion.duration_s(limits)
    except MotionError as error:
        refused = str(error)
    return MotionAnswer(name=name, purpose=motion.purpose, duration_s=duration_s, refused=refused)


async def _run(line: list[str]) -> tuple[int, str]:
    """Exit status of a command, and the last line that it said."""
    process = await asyncio.create_subprocess_exec(
        *limited_command(line, _LIMITS, dies_with_caller=True),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        async with asyncio.timeout(_LONGEST_S):
            _, said = await process.communicate()
    except TimeoutError:
        raise RefusedError(503, f"it took more than {_LONGEST_S:g} s") from None
    finally:
        if process.returncode is None:
            process.kill()
            await process.wait()
    return process.returncode or 0, said.decode(errors="replace").strip().rpartition("\n")[2]
