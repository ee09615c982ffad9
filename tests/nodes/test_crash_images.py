"""The health node, killed at every point at which it writes: what was told is there, once."""

import asyncio
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from edge_service import atomic, kept_database
from edge_service.config_tables import HistoryConfig
from edge_service.health.events.audit import BEGUN, AuditEntry
from edge_service.health.events.diary import Diary
from edge_service.messages.alarm import AlarmKind, Command, Outcome
from edge_service.messages.event import Event
from edge_service.messages.health import AxisHealth
from edge_service.messages.sentence import Told
from edge_service.messages.topics import Topic
from edge_service.nodes.health_node import _Monitors
from edge_service.nodes.stores.diary_store import DIARY, DiaryStore
from edge_service.nodes.stores.watch_store import snapshot_path
from edge_service.nodes.wiring import announcer

from .conftest import config_of, heart

NS = 10**9
EVER = 2**62


class Context:
    """Part of the node's context that the monitors need; publications are told to the test."""

    def __init__(self, folder: Path, publish: Any) -> None:
        self.config = config_of("simulated", {}, history=HistoryConfig(folder=folder))
        self.diary = DiaryStore(folder)
        self._publish = publish

    def publisher(self, _axis: str, _topic: Topic[Any]) -> Any:
        context = self

        class Publisher:
            def publish(self, payload: Any, _time_ns: int) -> None:
                context._publish(payload)

        return Publisher()


class Scene:
    """A health node on a folder of which an image is taken wherever it is written."""

    def __init__(self, folder: Path, kept: Path | None = None) -> None:
        self.folder = kept or folder / "kept"
        self._images = folder / "images"
        self.told: list[Event | AlarmKind | str] = []
        self.outcomes: list[Outcome] = []
        self.images: list[tuple[Path, tuple[Any, ...]]] = []
        self.context = Context(self.folder, self.on_publish)
        self.monitors = _Monitors(self.context)  # type: ignore[arg-type]

    def on_publish(self, payload: Any) -> None:
        if isinstance(payload, Event):
            self.told.append(payload)
            assert {"headline", "task"} <= payload.data.keys() or "alarm" not in payload.data
        if isinstance(payload, AxisHealth):
            self.told += [alarm.kind for alarm in payload.alarms if alarm.active]
        self.image()

    def image(self) -> None:
        """Files that a crash would leave here, and what had been told by then."""
        image = self._images / f"{len(self.images)}"
        shutil.copytree(self.folder, image)
        self.images.append((image, tuple(self.told)))

    async def announce(self) -> None:
        """Let the node's two tasks work off what waits."""
        queue = self.monitors.announcer
        tasks = [asyncio.create_task(work(heart())) for work in (queue.announce, queue.write)]
        async with asyncio.timeout(60.0):
            while not queue.idle:
                await asyncio.sleep(0.001)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def raise_alarm(self, kind: AlarmKind) -> None:
        """The cause of an alarm holds, for as long as it must."""
        latch = self.monitors.axes["X"]._alarms._latches[kind]
        events = latch.update(True, Told(f"{kind} is raised"), NS) or latch.update(
            True, Told(""), 100 * NS
        )
        assert [event.kind for event in events] == ["alarm_raised"]
        self.monitors._say("X", events)

    def command(self, **members: Any) -> None:
        """A person asks; an outcome that is kept is told."""
        command = Command.model_validate({"user": "Kim"} | members)

        def told(outcome: Outcome) -> None:
            self.outcomes.append(outcome)
            if outcome.accepted and outcome.kept:
                self.told.append(f"{command.action} {command.note}")

        self.monitors.obey("X", command, told)


@contextmanager
def images_of(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Take an image at every statement of SQLite, and at every step of a file that is replaced."""
    connected, sync, replace = kept_database._connected, atomic.os.fsync, Path.replace

    def traced(path: Path | str, schema: str) -> Any:
        file = connected(path, schema)
        file.set_trace_callback(lambda _statement: scene.image())
        return file

    def synced(handle: int) -> None:
        scene.image()
        sync(handle)

    def replaced(self: Path, target: Path) -> Path:
        scene.image()
        done = replace(self, target)
        scene.image()
        return done

    with monkeypatch.context() as patched:
        patched.setattr(kept_database, "_connected", traced)
        patched.setattr(atomic.os, "fsync", synced)
        patched.setattr(Path, "replace", replaced)
        patched.setattr(announcer, "PATIENCE_S", 60.0)  # images take longer than a disk may
        scene.context.diary.diary._file.close()
        yield


def _words(entry: AuditEntry) -> str:
    return f"{entry.action} {entry.data.get('note', '')}"


def check(image: Path, told: tuple[Any, ...]) -> None:
    """A start on what a crash has left knows all that was told, and nothing twice."""
    context = Context(image, lambda _payload: None)
    try:
        monitor = _Monitors(context).axes["X"]  # type: ignore[arg-type]
        events = [each.event for each in context.diary.diary.between(0, EVER, "X", 1000)]
        keys = [event.model_dump_json() for event in events]
        assert len(set(keys)) == len(keys)
        entries = [each.entry for each in context.diary.diary.records(1, 1000) if each.entry]
        noted, begun = (
            [_words(each) for each in entries if each.outcome == outcome]
            for outcome in ("done", BEGUN)
        )
        assert len(set(noted)) == len(noted)
        assert len(set(begun)) == len(begun)
        assert set(noted) <= set(begun)
        done = {event.message for event in events if event.kind in ("note", "part_replaced")}
        assert done <= {f"{words.partition(' ')[2]} (Kim)" for words in begun}
        latches = monitor._alarms._latches
        for each in told:
            if isinstance(each, Event):
                assert each in events
            elif isinstance(each, AlarmKind):
                assert latches[each].active
            else:
                assert each in noted
        raised = {event.data["alarm"] for event in events if event.kind == "alarm_raised"}
        assert raised <= {kind.value for kind, latch in latches.items() if latch.active}
    finally:
        context.diary.close()


@pytest.mark.parametrize("kind", AlarmKind)
async def test_an_alarm_that_was_shown_is_latched_after_any_crash(
    kind: AlarmKind, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene(tmp_path)
    with images_of(scene, monkeypatch):
        scene.raise_alarm(kind)
        await scene.announce()
    scene.context.diary.close()
    assert kind in scene.told
    assert len(scene.images) > 10
    for image, told in scene.images:
        check(image, told)


async def test_a_command_that_was_accepted_is_done_after_any_crash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene(tmp_path)
    with images_of(scene, monkeypatch):
        for number in range(3):
            scene.command(action="note", note=f"note {number}")
            await scene.announce()
        scene.command(action="shelve", alarm="rate")
        scene.command(action="part_replaced", note="new nut")
        await scene.announce()
    scene.context.diary.close()
    assert [each for each in scene.told if isinstance(each, str)] == [
        *(f"note note {number}" for number in range(3)),
        "shelve ",
        "part_replaced new nut",
    ]
    for image, told in scene.images:
        check(image, told)


KEYED = [
    {"action": "note", "note": "greased", "key": "a"},
    {"action": "part_replaced", "note": "new nut", "key": "b"},
    {"action": "unshelve", "alarm": "rate", "key": "c"},
    {"action": "shelve", "alarm": "rate", "key": "d"},
]


async def test_a_command_that_is_asked_again_after_any_crash_is_done_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = Scene(tmp_path)
    with images_of(scene, monkeypatch):
        for command in KEYED:
            scene.command(**command)
            await scene.announce()
    scene.context.diary.close()
    for image, told in scene.images:
        check(image, told)
        again = Scene(tmp_path / "again" / image.name, image)
        for command in KEYED:
            again.command(**command)
            again.command(**command)  # and once more, while the first is on its way
        await again.announce()
        outcomes = [each.accepted for each in again.outcomes]
        assert outcomes == [True, True, True, True, False, False, True, True]
        events = [each.event for each in again.context.diary.diary.between(0, EVER, "X", 1000)]
        kinds = [event.kind for event in events if event.data.get("user") or "shelv" in event.kind]
        assert sorted(kinds) == ["alarm_shelved", "note", "part_replaced"]
        again.context.diary.close()


async def test_an_event_that_only_the_state_holds_comes_into_the_diary(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    scene.raise_alarm(AlarmKind.SUDDEN_DROP)
    await scene.announce()
    scene.context.diary.close()
    (scene.folder / DIARY).unlink()
    for beside in scene.folder.glob(f"{DIARY}-*"):
        beside.unlink()
    context = Context(scene.folder, lambda _payload: None)
    _Monitors(context)  # type: ignore[arg-type]
    assert [each.event.kind for each in context.diary.diary.after(0, 10)] == ["alarm_raised"]
    context.diary.close()


async def test_a_command_that_cannot_be_kept_is_not_accepted(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    scene.context.diary.close()
    state = snapshot_path(scene.folder, "X").parent
    shutil.rmtree(scene.folder)
    scene.folder.write_text("in the way")
    outcomes: list[Outcome] = []
    scene.image = lambda: None  # type: ignore[method-assign]
    command = Command(action="note", user="Kim", note="lost?")
    scene.monitors.obey("X", command, outcomes.append)
    await scene.announce()
    assert [(each.accepted, each.kept) for each in outcomes] == [(True, False)]
    assert scene.monitors.problems()
    scene.folder.unlink()
    scene.monitors.keep()
    await scene.announce()
    scene.context.diary.diary.care(0.0)
    assert not scene.monitors.problems()
    assert (state / "watch.json").exists()
    scene.context.diary.close()
    diary = Diary(scene.folder / DIARY)
    assert [each.event.kind for each in diary.after(0, 10)] == ["note"]
    entries = [each.entry for each in diary.records(1, 10)]
    assert [(each.outcome, each.data["note"]) for each in entries] == [
        ("begun", "lost?"),
        ("done", "lost?"),
    ]
    diary.close()
