"""Whatever a kept file holds, a start goes on: it is taken, or set aside, named and counted."""

import json
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from edge_service.atomic import write_checked
from edge_service.config import EstimatorConfig
from edge_service.estimate.registry import make_estimator
from edge_service.health.alarms.axis_alarms import AlarmSettings
from edge_service.health.axis_monitor import AxisFacts, AxisMonitor
from edge_service.health.settings import HealthSettings
from edge_service.health.trend.usage import ScrewGeometry
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.header import Header
from edge_service.nodes.stores.estimate_store import DAMAGED, EstimateStore, Kept, StateError
from edge_service.nodes.stores.watch_store import WatchStore, snapshot_path
from edge_service.nodes.wiring.estimated_axis import EstimatedAxis

from ..bench.estimator.axis import OwnAxis
from ..documents import ROOT

NS = 10**9
NOW_NS = 1_795_000_000 * NS
RAW = ["[]", "{}", "1", '"x"', "null", "NaN", "", "[[", "[" * 100_000, '{"a": ', "\x00", "true"]
SHAPES: list[Any] = [[], {}, 1, -1, "x", None, True, math.nan, math.inf, 1e308, 2**70, [[]], ""]
RECORDED = json.loads((ROOT / "tests/health/recorded_snapshot.json").read_text("utf-8"))
FUSED = json.loads((ROOT / "tests/estimate/states/fused.json").read_text("utf-8"))


def monitor() -> AxisMonitor:
    geometry = ScrewGeometry(0.02 / (2.0 * math.pi), 0.8)
    facts = AxisFacts("X", 6.85, geometry)
    return AxisMonitor(facts, HealthSettings(), AlarmSettings(), NOW_NS)


def places(document: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place in a document, of lists the first three."""
    yield path
    if isinstance(document, dict):
        for key, value in document.items():
            yield from places(value, (*path, key))
    elif isinstance(document, list):
        for number, value in enumerate(document[:3]):
            yield from places(value, (*path, number))


def with_shape(document: Any, path: tuple[Any, ...], shape: Any) -> Any:
    """The document with something else at a place."""
    if not path:
        return shape
    first, *rest = path
    changed: Any = dict(document) if isinstance(document, dict) else list(document)
    changed[first] = with_shape(document[first], tuple(rest), shape)
    return changed


def use(monitor: AxisMonitor) -> None:
    """All that the node does with a monitor."""
    header = Header(0, 1, NOW_NS, NOW_NS)
    estimate = PreloadEstimate(
        time_s=0.0, status=EstimateStatus.ESTIMATED, preload_percent=6.0, low=5.5, high=6.5
    )
    monitor.on_preload(header, estimate, NOW_NS)
    monitor.tick(NOW_NS)
    monitor.health(NOW_NS).model_dump_json()
    monitor.take_trend(monitor.trend_work()(), NOW_NS)
    json.dumps(monitor.snapshot(), allow_nan=False)


def starts(folder: Path) -> int:
    """Start with what the folder holds; files that were set aside."""
    store = WatchStore(folder)
    use(store.load("X", monitor))
    store.announced("X")
    assert len(list(snapshot_path(folder, "X").parent.glob("*.damaged*"))) == len(store.damages)
    return len(store.damages)


@pytest.mark.parametrize("content", RAW, ids=range(len(RAW)))
def test_a_state_of_any_content_is_set_aside_and_counted(content: str, tmp_path: Path) -> None:
    path = snapshot_path(tmp_path, "X")
    path.parent.mkdir()
    path.write_text(content)
    assert starts(tmp_path) == 1
    assert not path.exists()


@pytest.mark.parametrize("part", [None, *RECORDED, "events"])
def test_a_state_of_any_shape_within_never_ends_a_start(part: str, tmp_path: Path) -> None:
    """Its digest is right: somebody else has written it."""
    document = RECORDED | {"events": []}
    path = snapshot_path(tmp_path, "X")
    for place in [()] if part is None else [(part, *each) for each in places(document[part])]:
        for shape in SHAPES:
            write_checked(path, json.dumps(with_shape(document, place, shape)))
            for old in path.parent.glob("*.damaged"):
                old.unlink()
            starts(tmp_path)


def test_a_folder_in_the_place_of_a_state_never_ends_a_start(tmp_path: Path) -> None:
    (snapshot_path(tmp_path, "X") / "full").mkdir(parents=True)
    assert starts(tmp_path) == 1


def estimated(folder: Path) -> EstimatedAxis:
    machine = OwnAxis(1, one_encoder=True).commissioned()
    axis = EstimatedAxis("X", make_estimator("fused", machine, EstimatorConfig(method="fused")))
    axis.restore(EstimateStore(folder, {"X": "abc"}))
    return axis


@pytest.mark.parametrize("content", RAW, ids=range(len(RAW)))
def test_an_estimate_of_any_content_is_set_aside(content: str, tmp_path: Path) -> None:
    path = EstimateStore(tmp_path, {}).path("X")
    path.parent.mkdir()
    path.write_text(content)
    estimated(tmp_path)
    assert [each.name for each in path.parent.iterdir()] == ["estimate.json.damaged"]


@pytest.mark.parametrize("part", FUSED)
def test_an_estimate_of_any_shape_within_is_refused_or_taken(part: str) -> None:
    """Every way in which reading a state can fail is one that the node expects."""
    machine = OwnAxis(1, one_encoder=True).commissioned()
    make = partial(make_estimator, "fused", machine, EstimatorConfig(method="fused"))
    for place in list(places(FUSED[part]))[:40]:
        for shape in SHAPES:
            estimator = make()
            try:
                estimator.restore(with_shape(FUSED, (part, *place), shape))
                estimator.estimate()
                json.dumps(estimator.snapshot(), allow_nan=False)
            except DAMAGED:
                continue


@pytest.mark.parametrize("member", ["time_s", "source_time_ns", "sha256", "axis", "schema"])
def test_a_kept_file_with_any_member_of_another_shape_is_refused(
    member: str, tmp_path: Path
) -> None:
    store = EstimateStore(tmp_path, {"X": "abc"})
    store.save({"X": Kept(1.0, NOW_NS, {"a": 1.0})})
    content = json.loads(store.path("X").read_text("utf-8"))["content"]
    for shape in SHAPES:
        write_checked(store.path("X"), json.dumps(content | {member: shape}))
        try:
            store.load("X", NOW_NS)
        except (StateError, OSError):
            continue
