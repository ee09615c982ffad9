"""Events are on the disk before anybody is told, and a disk that hangs holds up no alarm."""

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, nullcontext
from pathlib import Path
from typing import Any

import pytest

from edge_service.health.store.events import EventLog, StoredEvent
from edge_service.health.store.store import Store, StoreFailedError
from edge_service.nodes import context as module
from edge_service.nodes.context import SILENT, EventDispatcher

from ..messages.examples import event_of
from .conftest import until


class Scene:
    """A dispatcher, and what was told with the events that were on the disk then."""

    def __init__(self, path: Path) -> None:
        self.log = EventLog(Store(path))
        self.dispatcher = EventDispatcher(self.log)
        self.told: list[tuple[str, str]] = []

    def put(self, *texts: str) -> None:
        def publish(kept: list[StoredEvent], problem: str) -> None:
            on_disk = [] if problem else [each.event.text for each in self.log.after(0, 100)]
            assert problem or {each.event.text for each in kept} <= set(on_disk)
            self.told += [(each.event.text, problem) for each in kept]

        self.dispatcher.put([event_of(text) for text in texts], publish)

    async def heard(self, count: int) -> list[tuple[str, str]]:
        await until(lambda: len(self.told) >= count)
        return self.told

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        task = asyncio.create_task(self.dispatcher.run(lambda _what: nullcontext()))
        try:
            yield
        finally:
            task.cancel()
            await asyncio.wait([task])


@pytest.fixture
def scene(tmp_path: Path) -> Any:
    made = Scene(tmp_path / "a.sqlite")
    yield made
    made.log.store.close()


async def test_events_are_told_in_order_after_they_are_kept(scene: Scene) -> None:
    async with scene.running():
        scene.put("one", "two")
        scene.put("three")
        assert await scene.heard(3) == [("one", ""), ("two", ""), ("three", "")]


async def test_a_disk_that_hangs_holds_nothing_up_and_loses_nothing(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE_S", 0.05)
    go_on, write = threading.Event(), scene.log.store.write

    def hang(work: Any) -> Any:
        go_on.wait()
        return write(work)

    monkeypatch.setattr(scene.log.store, "write", hang)
    async with scene.running():
        scene.put("one")
        assert await scene.heard(1) == [("one", SILENT)]
        scene.put("two")
        assert (await scene.heard(2))[1:] == [("two", SILENT)]
        go_on.set()

        async def kept_again() -> bool:
            scene.put("more")
            await asyncio.sleep(0)
            return scene.told[-1] == ("more", "")

        await until(kept_again)
    kept = [each.event.text for each in scene.log.after(0, 1000)]
    assert kept[:2] == ["one", "two"]
    assert set(kept[2:]) == {"more"}


async def test_a_disk_that_takes_nothing_is_said_once_and_again_when_it_does(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail(_work: Any) -> None:
        scene.log.store.problem = "disk full"
        raise StoreFailedError("disk full")

    with monkeypatch.context() as broken:
        broken.setattr(scene.log.store, "write", fail)
        async with scene.running():
            scene.put("one")
            assert await scene.heard(1) == [("one", "disk full")]
        assert [e.kind for _ in range(2) for e in scene.dispatcher.news(1)] == ["store_failing"]
    scene.dispatcher.flush()
    scene.log.store.damages += ["x: damaged", "y: damaged"]
    monkeypatch.setattr(module, "WATCH_PERIOD_S", 0.0)
    kinds = ["store_recovered", "store_damaged"]
    with pytest.raises(ValueError, match="not in list"):  # by the second damage
        await scene.dispatcher.watch(lambda event: kinds.remove(event.kind))
    assert kinds == []
    assert caplog.messages[1:] == ["x: damaged", "y: damaged"]
    assert [each.event.text for each in scene.log.after(0, 10)] == ["one"]


async def test_what_waits_at_the_end_is_kept_and_told(scene: Scene) -> None:
    scene.put("one")
    scene.put("two")
    scene.dispatcher.flush()
    assert scene.told == [("one", ""), ("two", "")]
