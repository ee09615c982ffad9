"""Whatever a kept file holds, a start goes on: it is taken, or set aside, named and counted."""

import contextlib
import json
import math
import re
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest

from edge_service.config import EstimatorConfig
from edge_service.config_tables import AlarmsConfig, StoreConfig
from edge_service.estimate.interface import make_estimator
from edge_service.health.axis_monitor import AxisMonitor
from edge_service.health.store.store import State
from edge_service.health.wear.usage import ScrewGeometry
from edge_service.messages.codec import Header
from edge_service.nodes import estimate_node, health_node
from edge_service.nodes.context import NodeContext
from edge_service.nodes.estimated_axis import DAMAGED, Kept, StateError

from ..bench.estimator.axis import OwnAxis
from ..documents import ROOT
from ..messages.examples import estimate_of
from ..messages.hostile import places, replaced
from .conftest import config_of

NS = 10**9
NOW_NS = 1_795_000_000 * NS
RAW = ["[]", "{}", "1", '"x"', "NaN", "", "[[", "[" * 100_000, '{"a": ', "\x00", "true"]
SHAPES: list[Any] = [[], {}, 1, -1, "x", None, True, math.nan, math.inf, 1e308, 2**70, [[]], ""]
RECORDED = json.loads((ROOT / "tests/health/recorded_snapshot.json").read_text("utf-8"))
MIXTURE = json.loads((ROOT / "tests/estimate/states/mixture.json").read_text("utf-8"))


def monitor() -> AxisMonitor:
    geometry = ScrewGeometry(0.02 / (2.0 * math.pi), 0.8)
    facts = ("X", 6.85, geometry)
    return AxisMonitor(*facts, AlarmsConfig(), NOW_NS)


def use(monitor: AxisMonitor) -> None:
    header = Header(0, 1, NOW_NS, NOW_NS)
    monitor.on_preload(header, estimate_of(6.0, 0.5), NOW_NS)
    monitor.tick(NOW_NS)
    monitor.health(NOW_NS).model_dump_json()
    monitor.take_trend(monitor.trend_work()(), NOW_NS)
    json.dumps(monitor.snapshot(), allow_nan=False)


def context_in(folder: Path) -> NodeContext:
    """Context whose publications nobody hears."""
    return NodeContext(config_of("simulated", {}, store=StoreConfig(folder=folder)), MagicMock())


def put_raw(context: NodeContext, name: str, body: str) -> None:
    """A state of any content, with the right checksum."""
    context.events.put((), NOW_NS, (State(name, "X", body),))
    context.events.save()


def names(context: NodeContext) -> list[str]:
    rows = context.store.read(lambda file: file.execute("SELECT name FROM states").fetchall())
    return [re.sub("-.*", "", name) for (name,) in rows]


@pytest.mark.parametrize("content", RAW, ids=range(len(RAW)))
def test_states_of_any_content_are_set_aside_and_counted(content: str, tmp_path: Path) -> None:
    context = context_in(tmp_path)
    with closing(context.store):
        put_raw(context, health_node.STATE, content)
        put_raw(context, estimate_node.STATE, content)
        monitors, estimators = health_node.Monitors(context), estimate_node.Estimators(context)
        monitors.load()
        estimators.load()
        assert monitors.damaged == estimators.damaged == 1
        use(monitors.axes["X"])
        monitors.keep("X")
        context.dispatcher.flush()
        (*_, told) = context.events.page(10)
        assert told.event.kind == "store_damaged"
        assert "monitor.damaged-" in told.event.text
        assert names(context) == ["estimate.damaged", "monitor", "monitor.damaged"]


@pytest.mark.parametrize("name", [health_node.STATE, estimate_node.STATE])
def test_a_state_whose_row_was_changed_is_set_aside(name: str, tmp_path: Path) -> None:
    context = context_in(tmp_path)
    with closing(context.store):
        put_raw(context, name, json.dumps(RECORDED))
        change = "UPDATE states SET body = replace(body, '1', '2')"
        context.store.write(lambda file: file.execute(change))
        monitors, estimators = health_node.Monitors(context), estimate_node.Estimators(context)
        monitors.load()
        estimators.load()
        assert names(context) == [f"{name}.damaged"]
        assert monitors.damaged + estimators.damaged == 1


@pytest.mark.parametrize("part", [None, *RECORDED])
def test_a_snapshot_of_any_shape_within_is_refused_or_taken(part: str | None) -> None:
    """Its digest is right: somebody else has written it."""
    for place in [()] if part is None else [(part, *e) for e in ((), *places(RECORDED[part], 3))]:
        for shape in SHAPES:
            restored = monitor()
            try:
                restored.restore(replaced(RECORDED, [(place, shape)]))
            except (ValueError, RecursionError):
                continue
            use(restored)


@pytest.mark.parametrize("part", MIXTURE)
def test_an_estimate_of_any_shape_within_is_refused_or_taken(part: str) -> None:
    """Every way in which reading a state can fail is one that the node expects."""
    machine = OwnAxis(1, one_encoder=True).commissioned()
    make = partial(make_estimator, "mixture", machine, EstimatorConfig(method="mixture"))
    for place in [(), *places(MIXTURE[part], 3)][:40]:
        for shape in SHAPES:
            estimator = make()
            try:
                estimator.restore(replaced(MIXTURE, [((part, *place), shape)]))
                estimator.estimate()
                json.dumps(estimator.snapshot(), allow_nan=False)
            except DAMAGED:
                continue


@pytest.mark.parametrize("member", ["time_s", "source_time_ns", "snapshot", "axis", "schema"])
def test_an_estimate_with_any_member_of_another_shape_is_refused(member: str) -> None:
    content = Kept(1.0, NOW_NS, {"a": 1.0}).document("X", "abc")
    for shape in SHAPES:
        with contextlib.suppress(StateError):
            Kept.of(content | {member: shape}, "X", "abc").as_of(NOW_NS)
