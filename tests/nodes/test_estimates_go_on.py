"""An estimate goes on over a restart: bit for bit after a short one, begun anew where it must."""

import asyncio
import base64
import hashlib
import json
import logging
import signal
import sys
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.atomic import read_checked
from edge_service.bus.session import Bus, BusSettings
from edge_service.config import (
    DEFAULT_CONFIG,
    DEFAULT_MACHINE,
    AxisConfig,
    BusConfig,
    EdgeConfig,
    EstimatorConfig,
    HttpConfig,
    load_machine,
)
from edge_service.config_tables import HistoryConfig
from edge_service.estimate.mixture.estimator import FusedPreloadEstimator
from edge_service.health.events.diary import Diary
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Event, Severity
from edge_service.messages.features import FeatureBlock
from edge_service.messages.header import Header
from edge_service.messages.health import ComponentStatus
from edge_service.messages.topics import EVENT, FEAT, PRELOAD, STATUS
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine, Quantity
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits
from edge_service.nodes.stores.diary_store import DIARY
from edge_service.nodes.stores.estimate_store import (
    AHEAD_S,
    LONGEST_STOP_S,
    UNKNOWN_STOP_S,
    EstimateStore,
    Kept,
    identity_of,
    read_kept,
    write_kept,
)
from edge_service.nodes.wiring.estimated_axis import EstimatedAxis
from edge_service.nodes.wiring.stages import make_downsampler
from edge_service.offline.replay import replay_trace

from .conftest import PATIENCE_S, Running, config_of, running, until

COMMISSIONED = DEFAULT_MACHINE.with_name("commissioned.toml")
PERCENT = 6.0
NS = 10**9
NODE = ("estimate",)


@cache
def machine() -> Machine:
    return load_machine(COMMISSIONED)


@cache
def blocks() -> tuple[FeatureBlock, ...]:
    """Twelve seconds of production of the axis that the machine file was commissioned on."""
    nominal = load_machine(DEFAULT_MACHINE)
    friction = {"guide_force_n": Quantity(value=60.0), "bearing_drag_nm": Quantity(value=0.05)}
    true = nominal.model_copy(update={"model": nominal.model.model_copy(update=friction)})
    limits, count = motion_limits(true), 12_000
    segments = MOTIONS["production"](limits, np.random.default_rng(1))
    targets = Setpoints(segments, limits.low_m, 1000.0).take(count)
    drive = FeedDrive(FeedDriveSettings.of_machine(true, 1000.0), limits.low_m, PERCENT, 1)
    frame = drive.advance(targets, np.full(count, PERCENT))
    return tuple(make_downsampler(config_in(None).downsample, true).push(frame))


def config_in(folder: Path | None, **changes: Any) -> EdgeConfig:
    axis = AxisConfig(name="X", machine=COMMISSIONED)
    return EdgeConfig(
        bus=BusConfig(endpoint="tcp/127.0.0.1:0"),
        http=HttpConfig(port=0),
        axes=(axis,),
        history=HistoryConfig(folder=folder),
        **changes,
    )


def one_piece(given: Sequence[FeatureBlock]) -> list[str]:
    """Estimates of an estimator that was never stopped."""
    estimator = FusedPreloadEstimator(machine())
    told = []
    for block in given:
        estimator.update(block)
        told.append(estimator.estimate().model_dump_json())
    return told


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Nobody waits for a node that compiles."""
    one_piece(blocks()[:20])


class Feed:
    """Sends intervals to an estimate node and hears its answers."""

    def __init__(self, service: Running, config: EdgeConfig) -> None:
        self._keys, self._bus = config.keys, service.bus
        self._answers = self._bus.subscribe(self._keys.key("X", PRELOAD), PRELOAD)
        self._reports = self._bus.subscribe(
            self._keys.all_components(STATUS),
            STATUS,
        )
        self._features = self._bus.publisher(self._keys.key("X", FEAT), FEAT, "X")

    async def ready(self) -> None:
        """The node is there."""
        async with asyncio.timeout(PATIENCE_S):
            async for _, _, report in self._reports:
                if report.component == "estimate" and report.status is ComponentStatus.OK:
                    return

    async def send(self, given: Sequence[FeatureBlock], begin_ns: int) -> list[str]:
        """The answers to intervals whose axis clock began at a UNIX time."""
        told = []
        answers = aiter(self._answers)
        async with asyncio.timeout(PATIENCE_S):
            for block in given:
                source_ns = begin_ns + round(block.time_s * NS)
                self._features.publish(block, source_ns)
                _, _, estimate = await anext(answers)
                told.append(estimate.model_dump_json())
        return told

    def tell(self, event: Event) -> None:
        """Report of the monitor on the axis."""
        publisher = self._bus.publisher(self._keys.key("X", EVENT), EVENT, "X")
        publisher.publish(event, event.time_ns)


async def fed(config: EdgeConfig, given: Sequence[FeatureBlock], begin_ns: int) -> list[str]:
    """One run of the node, from start to clean stop."""
    async with running(config, NODE) as service:
        feed = Feed(service, config)
        await feed.ready()
        return await feed.send(given, begin_ns)


def state_file(folder: Path) -> Path:
    return folder / "axis=X" / "estimate.json"


async def test_a_stopped_and_restarted_service_goes_on_bit_equal(tmp_path: Path) -> None:
    config, begin_ns = config_in(tmp_path), time.time_ns() - 20 * NS
    first = await fed(config, blocks()[:70], begin_ns)
    second = await fed(config, blocks()[70:], begin_ns)
    assert first + second == one_piece(blocks())
    assert json.loads(second[0])["status"] == "estimated"


async def test_a_killed_service_goes_on_from_what_was_kept_last(tmp_path: Path) -> None:
    """A process of its own that keeps its state ten times a second, killed by SIGKILL."""
    config = config_in(tmp_path)
    bus = await Bus.open(BusSettings(config.bus.endpoint, "router", "open"))
    file = tmp_path / "edge.toml"
    file.write_text(
        f"[bus]\nsecurity = 'open'\n[history]\nfolder = '{tmp_path}'\n"
        f"[[axes]]\nname = 'X'\nmachine = '{COMMISSIONED}'\n"
    )
    code = (
        "from edge_service.cli.entry import main; from edge_service.nodes import estimate_node;"
        "estimate_node.SAVE_PERIOD_S = 0.1;"
        f"main(['node', 'estimate', {str(file)!r}, '--bus', {bus.endpoint!r}])"
    )
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-c", code, stderr=asyncio.subprocess.DEVNULL
    )
    try:
        feed = Feed(Running(bus, asyncio.Future(), asyncio.current_task()), config)  # type: ignore[arg-type]
        await feed.ready()
        begin_ns = time.time_ns() - 20 * NS
        await feed.send(blocks()[:60], begin_ns)

        async def kept() -> Any:
            path = state_file(tmp_path)
            content = json.loads(read_checked(path) or "{}")
            return content.get("time_s") == blocks()[59].time_s

        await until(kept)
    finally:
        process.send_signal(signal.SIGKILL)
        await process.wait()
        await bus.close()
    later = await fed(config, blocks()[75:], begin_ns)
    assert later == one_piece([*blocks()[:60], *blocks()[75:]])[60:]


async def test_after_a_stop_on_a_new_clock_the_preload_is_known_but_less(tmp_path: Path) -> None:
    """The clock begins anew after three hours: the interval is wider, but not that of a start."""
    config, begin_ns = config_in(tmp_path), time.time_ns() - 4 * 3600 * NS
    before = [PreloadEstimate.model_validate_json(one) for one in one_piece(blocks())]
    await fed(config, blocks(), begin_ns)
    after_ns = begin_ns + 3 * 3600 * NS
    again = await fed(config, blocks(), after_ns)
    told = [PreloadEstimate.model_validate_json(one) for one in again]
    numbers = [one for one in told if one.status is EstimateStatus.ESTIMATED]
    first = next(e for e in before if e.status is EstimateStatus.ESTIMATED)
    assert numbers[0].high - numbers[0].low < first.high - first.low  # type: ignore[operator]
    assert numbers[0].high - numbers[0].low > before[-1].high - before[-1].low  # type: ignore[operator]
    assert all(one.low <= PERCENT <= one.high for one in numbers)  # type: ignore[operator]


def replaced(now_ns: int) -> Event:
    """The monitor's word that the part of axis X was replaced."""
    info = Severity.INFO
    return Event(axis="X", kind="part_replaced", severity=info, message="Kim", time_ns=now_ns)


async def test_a_part_replaced_while_the_estimator_was_away_is_not_the_old_one(
    tmp_path: Path,
) -> None:
    config, begin_ns = config_in(tmp_path), time.time_ns() - 20 * NS
    await fed(config, blocks()[:40], begin_ns)
    assert state_file(tmp_path).exists()
    diary = Diary(tmp_path / DIARY)
    diary.add((replaced(time.time_ns()),), time.time_ns())
    diary.close()
    later = blocks()[40:60]
    assert await fed(config, later, begin_ns) == one_piece(later)


async def test_a_replaced_part_is_not_taken_for_the_old_one(tmp_path: Path) -> None:
    config, begin_ns = config_in(tmp_path), time.time_ns() - 20 * NS
    async with running(config, NODE) as service:
        feed = Feed(service, config)
        await feed.ready()
        await feed.send(blocks()[:40], begin_ns)
        state_file(tmp_path).parent.mkdir(exist_ok=True)
        state_file(tmp_path).write_text("old")
        feed.tell(replaced(time.time_ns()))

        async def forgotten() -> bool:
            return not state_file(tmp_path).exists()

        await until(forgotten)
        assert await feed.send(blocks()[40:60], begin_ns) == one_piece(blocks()[40:60])


async def test_without_a_folder_nothing_is_kept() -> None:
    begin_ns = time.time_ns() - 20 * NS
    config = config_of("simulated", {})
    config = config.model_copy(update={"axes": config_in(None).axes})
    await fed(config, blocks()[:30], begin_ns)
    assert await fed(config, blocks()[30:40], begin_ns) == one_piece(blocks()[30:40])


async def test_a_replay_neither_reads_nor_leaves_a_state(trace_path: Path, tmp_path: Path) -> None:
    state_file(tmp_path).parent.mkdir()
    state_file(tmp_path).write_text("of the axis itself")
    config = config_in(tmp_path)
    answer = await replay_trace(
        config, trace_path, COMMISSIONED, 0.0, loop=False, hold=False, announce=str
    )
    assert "199 estimates" in answer.words
    assert state_file(tmp_path).read_text() == "of the axis itself"
    assert not list(state_file(tmp_path).parent.glob("*.damaged"))


# what is refused


def store_in(folder: Path, of: Machine | None = None) -> EstimateStore:
    return EstimateStore(folder, {"X": identity_of(of or machine(), EstimatorConfig())})


def keep_some(folder: Path, end_ns: int) -> None:
    axis = EstimatedAxis("X", FusedPreloadEstimator(machine()))
    for number, block in enumerate(blocks()[:50]):
        axis.take(Header(number, 1, end_ns - (49 - number) * NS // 10, 0), block)
    kept = axis.to_keep()
    assert kept is not None
    store_in(folder).save({"X": kept})


def edited(**changes: Any) -> Callable[[str], str]:
    return lambda text: json.dumps(json.loads(text) | changes)


def other_state(text: str) -> str:
    """A state of another estimator, whole."""
    state = json.dumps({"schema": "imm-preload/2"})
    return edited(state=state, sha256=hashlib.sha256(state.encode()).hexdigest())(text)


def not_finite(text: str) -> str:
    """A state that was whole when it was written, of a filter that had failed."""
    state = json.loads(json.loads(text)["state"])
    arrays = state["bank"]["arrays"]
    mean = np.frombuffer(base64.b64decode(arrays["mean"])).copy()
    mean[3] = np.nan
    arrays["mean"] = base64.b64encode(mean.tobytes()).decode()
    told = json.dumps(state)
    return edited(state=told, sha256=hashlib.sha256(told.encode()).hexdigest())(text)


DAMAGED: dict[str, Callable[[str], str]] = {
    "torn": lambda text: text[: len(text) // 2],
    "empty": lambda _text: "",
    "garbage": lambda _text: "\x00\x01{[",
    "deep": lambda _text: "[" * 100_000,
    "of other kind": lambda _text: '{"schema": "axis-watch/1", "axis": "X"}',
    "a list": lambda _text: "[1, 2]",
    "of another axis": edited(axis="Y"),
    "a digit off": lambda text: text.replace("A", "B", 1),
    "without time": edited(time_s=float("inf")),
    "of another estimator": other_state,
    "not finite": not_finite,
}


def fresh_and_warned(store: EstimateStore, caplog: pytest.LogCaptureFixture, *words: str) -> None:
    """One line says why, and the estimator is as new."""
    axis = EstimatedAxis("X", FusedPreloadEstimator(machine()))
    with caplog.at_level(logging.WARNING):
        axis.restore(store)
    (record,) = caplog.records
    for word in ("estimate.json", "starts over", *words):
        assert word in record.getMessage()
    told = [
        axis.take(Header(n, 1, time.time_ns(), 0), block).model_dump_json()
        for n, block in enumerate(blocks()[:20])
    ]
    assert told == one_piece(blocks()[:20])


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_state_is_set_aside(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    keep_some(tmp_path, time.time_ns())
    path = state_file(tmp_path)
    spoiled = DAMAGED[name](read_checked(path) or "")
    path.write_text(spoiled)
    fresh_and_warned(store_in(tmp_path), caplog, "kept as estimate.json.damaged")
    assert path.with_name("estimate.json.damaged").read_text() == spoiled
    assert not path.exists()


def test_a_state_that_is_too_old_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    keep_some(tmp_path, time.time_ns() - round((LONGEST_STOP_S + 3600.0) * NS))
    fresh_and_warned(store_in(tmp_path), caplog, "30 days old")


@pytest.mark.parametrize("ahead_s", [2 * AHEAD_S, 74 * 365 * 86400.0])
def test_a_state_of_the_future_counts_as_of_a_day_ago(
    ahead_s: float, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    now_ns = time.time_ns()
    keep_some(tmp_path, now_ns + round(ahead_s * NS))
    kept = store_in(tmp_path).load("X", now_ns)
    assert kept is not None
    assert now_ns - kept.source_time_ns == UNKNOWN_STOP_S * NS
    assert "in the future" in caplog.text


def test_a_state_is_kept_after_the_clock_was_set_back(tmp_path: Path) -> None:
    axis, store = EstimatedAxis("X", FusedPreloadEstimator(machine())), store_in(tmp_path)
    for number, source_ns in enumerate((9000 * NS, 1800 * NS)):
        axis.take(Header(number, 1, source_ns, 0), blocks()[number])
        kept = axis.to_keep()
        assert kept is not None
        store.save({"X": kept})
    assert json.loads(read_checked(store.path("X")) or "")["source_time_ns"] == 1800 * NS


@pytest.mark.parametrize("step_s", [74 * 365 * 86400.0, -7200.0])
def test_a_step_of_the_clock_changes_no_estimate(step_s: float) -> None:
    axis, told = EstimatedAxis("X", FusedPreloadEstimator(machine())), []
    for number, block in enumerate(blocks()):
        if number == 50:
            axis.move(round(step_s * NS))
        source_s = 1.8e9 + block.time_s + (step_s if number >= 50 else 0.0)
        estimate = axis.take(Header(number, 1, round(source_s * NS), 0), block)
        told.append(estimate.model_dump_json())
    assert told == one_piece(blocks())


def test_a_state_of_another_machine_file_is_refused(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    keep_some(tmp_path, time.time_ns())
    heavier = machine().model.model_copy(update={"inertia_kg_m2": Quantity(value=2e-3)})
    other = machine().model_copy(update={"model": heavier})
    fresh_and_warned(store_in(tmp_path, other), caplog, "another machine file")


def test_a_state_that_cannot_be_read_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    state_file(tmp_path).mkdir(parents=True)
    fresh_and_warned(store_in(tmp_path), caplog)


def test_an_older_state_never_replaces_a_newer_one(tmp_path: Path) -> None:
    axis, store = EstimatedAxis("X", FusedPreloadEstimator(machine())), store_in(tmp_path)
    kept = []
    for number, block in enumerate(blocks()[:2]):
        axis.take(Header(number, 1, (number + 1) * NS, 0), block)
        each = axis.to_keep()
        assert each is not None
        kept.append(each)
    assert axis.to_keep() is None  # nothing new
    store.save({"X": kept[1]})
    store.save({"X": kept[0]})
    assert json.loads(read_checked(state_file(tmp_path)) or "")["source_time_ns"] == 2 * NS


def test_a_state_of_the_part_before_is_not_written_behind_its_back(tmp_path: Path) -> None:
    """A thread may be about to write it when the part is replaced."""
    store = store_in(tmp_path)
    axis = EstimatedAxis("X", FusedPreloadEstimator(machine()))
    axis.take(Header(0, 1, NS, 0), blocks()[0])
    of_old = axis.to_keep()
    assert of_old is not None
    store.forget("X", axis.forget())
    store.save({"X": of_old})
    assert not store.path("X").exists()
    axis.take(Header(1, 1, 2 * NS, 0), blocks()[1])
    of_new = axis.to_keep()
    assert of_new is not None
    store.save({"X": of_new})
    assert json.loads(read_checked(store.path("X")) or "")["source_time_ns"] == 2 * NS


def test_the_default_configuration_keeps_nothing() -> None:
    assert EdgeConfig.model_validate({"axes": [{"name": "X"}]}).history.folder is None
    assert "# folder" in DEFAULT_CONFIG.read_text()


def test_a_state_of_version_0_1_0_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "estimate.json"
    recorded = (
        '{"schema": "estimate-state/1", "axis": "X", "machine": "abc", "time_s": 1.5, '
        '"source_time_ns": 9, '
        '"sha256": "e569038494a75bd161110408b3abdabca299c67bd3d4d0aad4f42af94423f88f", '
        '"state": "{\\"schema\\": \\"x/1\\", \\"a\\": [1.0]}"}'
    )
    path.write_text(recorded)
    kept = read_kept(path, "X", "abc")
    assert kept == Kept(1.5, 9, {"schema": "x/1", "a": [1.0]})
    write_kept(path, "X", "abc", kept)
    assert read_checked(path) == recorded
