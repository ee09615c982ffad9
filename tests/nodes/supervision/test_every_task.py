"""Every task of a running service, ended, raising and hung on purpose, one after the other."""

import asyncio
from pathlib import Path

import pytest

from edge_service.config import EdgeConfig
from edge_service.messages.event import Event
from edge_service.messages.health import ComponentStatus
from edge_service.messages.topics import EVENT, PRELOAD, STATUS
from edge_service.nodes.service import PIPELINE
from edge_service.nodes.supervision.heartbeat import Heartbeat
from edge_service.nodes.supervision.policy import RestartPolicy
from edge_service.nodes.supervision.supervisor import Supervisor
from edge_service.nodes.supervision.task import SupervisedTask, TaskState

from ...drivers.bench import free_port
from ..conftest import config_of, running, until

AT_ONCE = RestartPolicy(first_s=0.0, most=1000)


async def end(_heart: Heartbeat) -> None:
    """End without a word."""


async def fail(_heart: Heartbeat) -> None:
    raise RuntimeError("on purpose")


async def hang(_heart: Heartbeat) -> None:
    await asyncio.Event().wait()


def two_axes(folder: Path) -> EdgeConfig:
    config = config_of("simulated", {"scenario": "healthy", "speed": 5.0})
    axis = config.axes[0]
    axes = (axis, axis.model_copy(update={"name": "Y"}))
    return config.model_copy(
        update={
            "axes": axes,
            "outputs": {"mqtt": {"url": f"mqtt://127.0.0.1:{free_port()}"}},
        }
    )


class Sabotage:
    """Lets one task after the other fail in one way."""

    def __init__(self, supervisor: Supervisor, how) -> None:
        self._supervisor = supervisor
        self._how = how

    def names(self) -> list[tuple[str, str]]:
        """Component and name of every task; those that own others come last."""
        pairs = [(group.component, task.name) for group in self._supervisor for task in group]
        return sorted(pairs, key=lambda pair: pair[0] == "service")

    def find(self, component: str, name: str) -> SupervisedTask | None:
        """The task as it is now."""
        for group in self._supervisor:
            for task in group:
                if (group.component, task.name) == (component, name):
                    return task
        return None

    async def strike(self, task: SupervisedTask) -> None:
        """Let the next life of a task begin now, and fail; then it works as before."""
        task.running.cancel()
        await asyncio.wait([task.running], timeout=10.0)
        work, task.work = task.work, self._how
        task.begin()
        task.work = work
        task.heart.forgive(-1000.0)  # its deadline has passed


@pytest.mark.parametrize("how", [end, fail, hang])
async def test_every_task_that_fails_is_told_and_begun_again(how, tmp_path: Path) -> None:
    config = two_axes(tmp_path)
    supervisor = Supervisor(policy=AT_ONCE)
    names = ("mqtt", *PIPELINE)
    async with running(config, names, supervisor=supervisor) as service:
        await asyncio.wait_for(service.address, 30.0)
        keys = config.keys
        events = service.bus.subscribe(keys.all_components(EVENT), EVENT, depth=4096)
        reports = service.bus.subscribe(keys.all_components(STATUS), STATUS, depth=4096)
        sabotage = Sabotage(supervisor, how)

        async def estimating() -> bool:
            return sabotage.find("estimate", "keep") is not None

        await until(estimating)
        struck = sabotage.names()
        assert len(struck) > 35
        sources: set[str] = set()
        for component, name in struck:
            task = sabotage.find(component, name)
            assert task is not None, name
            if task.rules.may_end and how is end:
                sources.add(name)
                continue
            before = task.restarts.total
            await sabotage.strike(task)

            async def begun_again(task=task, before=before) -> bool:
                supervisor.look()
                return task.restarts.total > before and task.state is TaskState.RUNNING

            await until(begun_again)
        preloads = service.bus.subscribe(keys.all_axes(PRELOAD), PRELOAD)
        heard: set[str] = set()
        async with asyncio.timeout(30.0):
            async for axis, _, _ in preloads:
                heard.add(axis)
                if heard == {"X", "Y"}:
                    break
        assert not service.task.done()
        events.close()
        reports.close()
        told = {_told(event) async for _, _, event in events if "task" in event.data}
        told -= {("service", "loop")}  # held up by other work of the machine
        degraded = {
            report.component
            async for _, _, report in reports
            if report.status is ComponentStatus.RECOVERABLE_ERROR
        }
    assert sources <= {"read", "acquire X", "acquire Y"}  # a recording may come to its end
    failed = {pair for pair in struck if pair[1] not in sources}
    assert told == {(component.partition(" ")[0], name) for component, name in failed}
    assert len(struck) == len(set(struck))
    assert degraded >= {component.partition(" ")[0] for component, _ in failed} - {"acquire"}


def _told(event: Event) -> tuple[object, object]:
    return event.data["component"], event.data["task"]
