"""An estimate goes on over a restart: bit for bit after a short one, begun anew where it must."""

import asyncio
import base64
import json
import logging
import signal
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

from edge_service.bus.session import Bus, BusSettings
from edge_service.config import DEFAULT_MACHINE, EdgeConfig, EstimatorConfig, load_machine
from edge_service.config_tables import StoreConfig
from edge_service.estimate.mixture.estimator import MixturePreloadEstimator
from edge_service.health.store.events import EventLog
from edge_service.health.store.store import FILE_NAME, State, Store, load_state
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Event
from edge_service.messages.features import FeatureBlock
from edge_service.messages.health import ComponentStatus
from edge_service.messages.topics import EVENT, FEAT, PRELOAD
from edge_service.models.machine import Machine, Quantity
from edge_service.nodes import estimate_node
from edge_service.nodes.context import NodeContext
from edge_service.nodes.estimated_axis import AHEAD_S, LONGEST_STOP_S, Kept, StateError, identity_of
from edge_service.nodes.stages import make_downsampler
from edge_service.offline.replay import replay_trace

from ..messages.examples import event_of
from .conftest import (
    PATIENCE_S,
    Running,
    config_of,
    estimated,
    production,
    reported,
    running,
    until,
)

COMMISSIONED = DEFAULT_MACHINE.with_name("commissioned.toml")
MACHINE = load_machine(COMMISSIONED)
PERCENT = 6.0
NS = 10**9
NODE = ("estimate",)


@cache
def blocks() -> tuple[FeatureBlock, ...]:
    """Twelve seconds of production of the axis that the machine file was commissioned on."""
    nominal = load_machine(DEFAULT_MACHINE)
    friction = {"guide_force_n": Quantity(value=60.0), "bearing_drag_nm": Quantity(value=0.05)}
    true = nominal.model_copy(update={"model": nominal.model.model_copy(update=friction)})
    return tuple(make_downsampler(true).push(production(true, PERCENT, 12_000)))


def config_in(folder: Path) -> EdgeConfig:
    return config_of("simulated", {}, COMMISSIONED, store=StoreConfig(folder=folder))


def one_piece(given: Sequence[FeatureBlock]) -> list[str]:
    """Estimates of an estimator that was never stopped."""
    estimator = MixturePreloadEstimator(MACHINE)
    told = []
    for block in given:
        estimator.update(block)
        told.append(estimator.estimate().model_dump_json())
    return told


class Feed:
    """Sends intervals to an estimate node and hears its answers."""

    def __init__(self, service: Running, config: EdgeConfig) -> None:
        self._keys, self._bus = config.keys, service.bus
        self._answers = self._bus.subscribe(self._keys.key("X", PRELOAD), PRELOAD)
        self._features = self._bus.publisher(self._keys.key("X", FEAT), FEAT, "X")

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
        await reported(service, "estimate", ComponentStatus.OK, "X")
        return await feed.send(given, begin_ns)


def store_in(folder: Path) -> Store:
    return Store(folder / FILE_NAME)


def document_in(folder: Path) -> Any:
    with closing(store_in(folder)) as store:
        return load_state(store, estimate_node.STATE, "X")


def put_state(folder: Path, document: Any) -> None:
    with closing(store_in(folder)) as store:
        log = EventLog(store)
        log.put((), 1, (State(estimate_node.STATE, "X", json.dumps(document)),))
        log.save()


async def test_a_stopped_and_restarted_service_goes_on_bit_equal(tmp_path: Path) -> None:
    config, begin_ns = config_in(tmp_path), time.time_ns() - 20 * NS
    first = await fed(config, blocks()[:70], begin_ns)
    second = await fed(config, blocks()[70:], begin_ns)
    assert first + second == one_piece(blocks())
    assert json.loads(second[0])["status"] == "estimated"


async def test_a_killed_service_goes_on_from_what_was_kept_last(tmp_path: Path) -> None:
    """A process of its own that keeps its state ten times a second, killed by SIGKILL."""
    config = config_in(tmp_path)
    bus = await Bus.open(BusSettings(config.bus.endpoint, "router", read_only=False))
    file = tmp_path / "edge.toml"
    file.write_text(
        f"[store]\nfolder = '{tmp_path}'\n[[axes]]\nname = 'X'\nmachine = '{COMMISSIONED}'\n"
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
        here: Any = SimpleNamespace(bus=bus, context=SimpleNamespace(config=config))
        feed = Feed(here, config)
        await reported(here, "estimate", ComponentStatus.OK, "X")
        begin_ns = time.time_ns() - 20 * NS
        await feed.send(blocks()[:60], begin_ns)
        kept_s = blocks()[59].time_s
        await until(lambda: (document_in(tmp_path) or {}).get("time_s") == kept_s)
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


async def test_a_part_replaced_while_estimator_was_away_is_not_the_old_one(tmp_path: Path) -> None:
    config, begin_ns = config_in(tmp_path), time.time_ns() - 20 * NS
    await fed(config, blocks()[:40], begin_ns)
    assert document_in(tmp_path)["axis"] == "X"
    with closing(store_in(tmp_path)) as store:
        event = event_of(kind="part_replaced", time_ns=time.time_ns())
        EventLog(store).add((event,), time.time_ns())
    later = blocks()[40:60]
    assert await fed(config, later, begin_ns) == one_piece(later)


async def test_a_replaced_part_is_not_taken_for_the_old_one(tmp_path: Path) -> None:
    config, begin_ns = config_in(tmp_path), time.time_ns() - 20 * NS
    async with running(config, NODE) as service:
        feed = Feed(service, config)
        await reported(service, "estimate", ComponentStatus.OK, "X")
        await feed.send(blocks()[:40], begin_ns)
        feed.tell(event_of(kind="part_replaced", time_ns=time.time_ns()))
        answers = await feed.send(blocks()[40:60], begin_ns)
        assert answers == one_piece(blocks()[40:60])
    assert document_in(tmp_path)["time_s"] == blocks()[59].time_s


async def test_a_replay_neither_reads_nor_leaves_a_state(trace_path: Path, tmp_path: Path) -> None:
    put_state(tmp_path, ["of the axis itself"])
    config = config_in(tmp_path)
    answer = await replay_trace(config, trace_path, COMMISSIONED, 0.0, hold=False, announce=str)
    assert "199 estimates" in answer.words
    assert document_in(tmp_path) == ["of the axis itself"]


# what is refused


def identity(of: Machine | None = None) -> str:
    return identity_of(of or MACHINE, EstimatorConfig())


def kept_at(end_ns: int) -> Kept:
    axis = estimated(lambda: MixturePreloadEstimator(MACHINE))
    for number, block in enumerate(blocks()[:50]):
        axis.take(Header(number, 1, end_ns - (49 - number) * NS // 10, 0), block)
    kept = axis.to_keep()
    assert kept is not None
    assert axis.to_keep() is None  # nothing new
    return kept


def not_finite(snapshot: dict[str, Any]) -> dict[str, Any]:
    """A state that was whole when it was written, of a filter that had failed."""
    changed: dict[str, Any] = json.loads(json.dumps(snapshot))
    arrays = changed["bank"]["arrays"]
    mean = np.frombuffer(base64.b64decode(arrays["mean"])).copy()
    mean[3] = np.nan
    arrays["mean"] = base64.b64encode(mean.tobytes()).decode()
    return changed


HEAVIER = MACHINE.model.model_copy(update={"inertia_kg_m2": Quantity(value=2e-3)})
OTHER = identity(MACHINE.model_copy(update={"model": HEAVIER}))
OLD_NS, ASIDE = round((LONGEST_STOP_S + 3600.0) * NS), "kept as estimate.damaged-"
REFUSED: dict[str, tuple[Callable[[Kept], Any], str]] = {
    "of other kind": (lambda _kept: {"schema": "axis-watch/1", "axis": "X"}, ASIDE),
    "a list": (lambda _kept: [1, 2], ASIDE),
    "of another axis": (lambda kept: kept.document("Y", identity()), ASIDE),
    "empty": (lambda kept: kept.document("X", identity()) | {"snapshot": {}}, ASIDE),
    "without time": (lambda kept: kept.document("X", identity()) | {"time_s": None}, ASIDE),
    "of another estimator": (lambda kept: replace(kept, snapshot={"schema": "imm/2"}), ASIDE),
    "not finite": (lambda kept: replace(kept, snapshot=not_finite(kept.snapshot)), ASIDE),
    "of another machine file": (lambda kept: kept.document("X", OTHER), "another machine file"),
    "too old": (
        lambda kept: replace(kept, source_time_ns=kept.source_time_ns - OLD_NS),
        "30 days old",
    ),
}
"""Damage to a state by its name, and the words of the refusal."""


@pytest.mark.parametrize("name", REFUSED)
def test_a_state_that_is_refused_is_said_in_a_line_and_the_estimator_is_as_new(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    change, said = REFUSED[name]
    changed = change(kept_at(time.time_ns()))
    is_whole = isinstance(changed, Kept)
    put_state(tmp_path, changed.document("X", identity()) if is_whole else changed)
    context = NodeContext(config_in(tmp_path), MagicMock())
    with closing(context.store), caplog.at_level(logging.WARNING):
        estimators = estimate_node.Estimators(context)
        estimators.load()
    (record,) = caplog.records
    for word in ("axis X", "starts over", said):
        assert word in record.getMessage()
    axis = estimators.axes["X"]
    told = [
        axis.take(Header(n, 1, time.time_ns(), 0), block).model_dump_json()
        for n, block in enumerate(blocks()[:20])
    ]
    assert told == one_piece(blocks()[:20])
    assert said != ASIDE or document_in(tmp_path) is None


@pytest.mark.parametrize("ahead_s", [2 * AHEAD_S, 74 * 365 * 86400.0])
def test_a_state_of_the_future_counts_as_of_a_day_ago(
    ahead_s: float, caplog: pytest.LogCaptureFixture
) -> None:
    now_ns = time.time_ns()
    kept = kept_at(now_ns + round(ahead_s * NS)).as_of(now_ns)
    assert now_ns - kept.source_time_ns == LONGEST_STOP_S * NS
    assert "in the future" in caplog.text


def test_a_state_of_a_part_that_was_replaced_is_refused() -> None:
    kept = Kept(1.0, 1000 * NS, {})
    with pytest.raises(StateError, match="replaced"):
        kept.as_of(1200 * NS, 1100 * NS)
    assert kept.as_of(1200 * NS, 900 * NS) == kept


@pytest.mark.parametrize("step_s", [74 * 365 * 86400.0, -7200.0])
def test_a_step_of_the_clock_changes_no_estimate(step_s: float) -> None:
    axis, told = estimated(lambda: MixturePreloadEstimator(MACHINE)), []
    for number, block in enumerate(blocks()):
        if number == 50:
            axis.move(round(step_s * NS))
        source_s = 1.8e9 + block.time_s + (step_s if number >= 50 else 0.0)
        estimate = axis.take(Header(number, 1, round(source_s * NS), 0), block)
        told.append(estimate.model_dump_json())
    assert told == one_piece(blocks())
