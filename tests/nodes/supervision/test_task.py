"""One task under a clock that the test sets: ended, hung, stuck, in a thread, given up, mended."""

import asyncio
import threading
from contextlib import suppress

import pytest

from edge_service.nodes.supervision.heartbeat import DEADLINE_S, Heartbeat
from edge_service.nodes.supervision.policy import RestartPolicy, Restarts
from edge_service.nodes.supervision.supervisor import Supervisor, TaskGivenUpError
from edge_service.nodes.supervision.task import PROVEN_S, TaskChange, TaskState, Work
from edge_service.nodes.supervision.tasks import Tasks

POLICY = RestartPolicy(first_s=1.0, cap_s=4.0, most=3, steady_s=60.0)


class Scene:
    """A supervisor whose looks and clock are the test's."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.supervisor = Supervisor(lambda: self.now_s, POLICY)
        self.told: list[TaskChange] = []
        self.tasks: Tasks = self.supervisor.tasks("part", self.told.append)

    async def pass_time(self, seconds: float, step_s: float = 0.2) -> None:
        """Let time pass, with a look five times a second and turns for the tasks."""
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            for _ in range(3):
                await asyncio.sleep(0)
            self.supervisor.look()

    def kinds(self) -> list[str]:
        return [change.kind for change in self.told]


@pytest.fixture
async def scene():
    scene = Scene()
    yield scene
    await scene.tasks.end()


async def raising(_heart: Heartbeat) -> None:
    raise ValueError("no such number")


async def ending(_heart: Heartbeat) -> None:
    """End as if nothing were left to do."""


async def hanging(_heart: Heartbeat) -> None:
    await asyncio.Event().wait()


async def beating(heart: Heartbeat) -> None:
    while True:
        heart.beat()
        await asyncio.sleep(0)


def failing_once(how: Work) -> Work:
    """Work that fails in its first life only."""
    lives = []

    async def work(heart: Heartbeat) -> None:
        lives.append(None)
        await (how if len(lives) == 1 else beating)(heart)

    return work


@pytest.mark.parametrize(
    ("how", "said"),
    [(raising, "ValueError: no such number"), (ending, "ended"), (hanging, "no sign of life")],
)
async def test_what_ends_or_hangs_is_seen_within_two_seconds_and_mended(
    scene: Scene, how: Work, said: str
) -> None:
    task = scene.tasks.start("work", failing_once(how))
    await scene.pass_time(2.0)
    assert scene.kinds() == ["task_failed"]
    assert said in scene.told[0].reason
    assert said in scene.tasks.faults()[0]
    await scene.pass_time(2.0 + PROVEN_S)
    assert scene.kinds() == ["task_failed", "task_recovered"]
    assert (task.state, scene.tasks.restarts, scene.tasks.faults()) == (TaskState.RUNNING, 1, [])


@pytest.mark.parametrize("how", [raising, ending, hanging])
async def test_what_fails_again_and_again_is_given_up_with_growing_pauses(
    scene: Scene, how: Work
) -> None:
    task = scene.tasks.start("work", how)
    await scene.pass_time(30.0)
    assert task.state is TaskState.GIVEN_UP
    assert scene.kinds().count("task_given_up") == 1
    assert task.restarts.total == POLICY.most
    assert scene.tasks.given_up
    assert scene.tasks.faults()[0].startswith("work given up after 3 restarts: ")


def test_pauses_double_up_to_a_cap_and_begin_anew_after_a_steady_run() -> None:
    restarts = Restarts(RestartPolicy(first_s=1.0, cap_s=3.0, most=4, steady_s=60.0))
    assert [restarts.pause_s(1.0) for _ in range(5)] == [1.0, 2.0, 3.0, 3.0, None]
    assert restarts.pause_s(60.0) == 1.0


async def test_giving_up_a_vital_task_ends_the_process_with_the_reason(scene: Scene) -> None:
    scene.tasks.start("work", raising, vital=True)
    with pytest.raises(TaskGivenUpError, match=r"part: work given up after 3 .*no such number"):
        await scene.pass_time(30.0)


async def test_a_task_that_cannot_be_ended_starves_the_watchdog(scene: Scene) -> None:
    heard = asyncio.Event()

    async def deaf(_heart: Heartbeat) -> None:
        while not heard.is_set():
            with suppress(asyncio.CancelledError):
                await heard.wait()

    scene.tasks.start("deaf", deaf)
    scene.tasks.start("other", beating)
    await scene.pass_time(2.0)
    before = scene.supervisor.is_well
    await scene.pass_time(13.0)
    after, kinds = scene.supervisor.is_well, scene.kinds()
    heard.set()
    assert (before, after, kinds) == (True, False, ["task_failed"])
    await scene.pass_time(2.0)
    assert scene.supervisor.is_well


async def test_a_mistake_ends_a_start_and_not_a_service_that_runs(scene: Scene) -> None:
    scene.supervisor.final = (ValueError,)
    scene.tasks.start("work", raising)
    with pytest.raises(ValueError, match="no such number"):
        await scene.pass_time(0.2)
    scene.now_s += 100.0
    scene.tasks.start("later", raising)
    await scene.pass_time(0.2)
    assert scene.kinds()[-1] == "task_failed"


async def test_a_standstill_of_the_loop_is_no_fault_of_a_task(scene: Scene) -> None:
    scene.tasks.start("work", beating)
    await scene.pass_time(1.0)
    scene.now_s += 20.0
    scene.supervisor.look()
    await scene.pass_time(1.0)
    assert scene.told == []
    assert scene.supervisor.lag.worst_s == pytest.approx(19.8)
    await scene.pass_time(11.0)
    assert scene.supervisor.lag.worst_s == pytest.approx(0.0, abs=1e-6)


async def test_a_thread_that_hangs_is_seen_holds_up_nobody_and_is_not_doubled(
    scene: Scene,
) -> None:
    release, begun = threading.Event(), []

    def block() -> None:
        begun.append(None)
        release.wait(30.0)

    async def work(heart: Heartbeat) -> None:
        while True:
            await heart.in_thread(block, limit_s=5.0)
            await heart.sleep(0.0)

    scene.tasks.start("disk", work)
    other = scene.tasks.start("other", beating)
    await scene.pass_time(4.0)
    assert scene.told == []
    await scene.pass_time(2.0)
    assert scene.kinds() == ["task_failed"]
    assert scene.told[0].reason == "hangs: check that the disk and the other side answer"
    await scene.pass_time(60.0)
    assert len(begun) == 1
    assert (other.restarts.total, scene.supervisor.is_well) == (0, True)
    release.set()
    async with asyncio.timeout(10.0):
        while scene.kinds()[-1] != "task_recovered":
            await asyncio.sleep(0.01)
            await scene.pass_time(0.2)


async def test_what_is_waited_for_patiently_is_shown_and_not_ended(scene: Scene) -> None:
    answered = asyncio.Event()

    async def work(heart: Heartbeat) -> None:
        await heart.patiently(answered.wait(), limit_s=5.0)
        await beating(heart)

    task = scene.tasks.start("peer", work)
    await scene.pass_time(4.0)
    assert scene.told == []
    await scene.pass_time(600.0, step_s=1.0)
    assert (scene.kinds(), task.restarts.total) == (["task_failed"], 0)
    answered.set()
    await scene.pass_time(1.0)
    assert scene.kinds() == ["task_failed", "task_recovered"]


async def test_an_idle_task_is_well_until_work_waits(scene: Scene) -> None:
    waits: list[int] = []

    async def work(heart: Heartbeat) -> None:
        with heart.idle(lambda: not waits):
            await asyncio.Event().wait()

    scene.tasks.start("work", work)
    await scene.pass_time(60.0)
    assert scene.told == []
    waits.append(1)
    await scene.pass_time(DEADLINE_S + 0.4)
    assert scene.kinds() == ["task_failed"]


async def test_work_that_may_end_ends_without_a_word(scene: Scene) -> None:
    task = scene.tasks.start("work", ending, may_end=True)
    await scene.pass_time(1.0)
    assert (task.state, task.done.is_set(), scene.told) == (TaskState.DONE, True, [])


async def test_a_thread_hands_over_what_its_work_returns_or_raises() -> None:
    heart = Heartbeat("test", 1.0, lambda: 0.0)
    assert await heart.in_thread(lambda: 5) == 5
    with pytest.raises(ZeroDivisionError):
        await heart.in_thread(lambda: 1 / 0)
    with pytest.raises(RuntimeError):
        await heart.in_thread(lambda: next(iter(())))
