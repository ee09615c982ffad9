"""Parts of the tests of the whole service."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import cache
from inspect import isawaitable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings
from edge_service.config import (
    DEFAULT_MACHINE,
    AxisConfig,
    EdgeConfig,
    EstimatorConfig,
    HttpConfig,
    load_machine,
)
from edge_service.config.service import BusConfig
from edge_service.estimate.interface import PreloadEstimator
from edge_service.messages.health import ComponentHealth, ComponentStatus
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.messages.topics import STATUS
from edge_service.models.effects.registry import parse_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, Setpoints, motion_limits
from edge_service.nodes.context import NodeContext
from edge_service.nodes.estimated_axis import EstimatedAxis
from edge_service.nodes.service import PIPELINE, run_nodes
from edge_service.nodes.stages import warm_up
from edge_service.recordings.writer import TraceWriter

PATIENCE_S = 60.0
RATE_HZ = 1000.0


def config_of(
    driver: str, settings: dict[str, Any], machine: Path = DEFAULT_MACHINE, **changes: Any
) -> EdgeConfig:
    axis = AxisConfig(name="X", machine=machine, driver=driver, settings=settings)
    places = {"bus": BusConfig(endpoint="tcp/127.0.0.1:0"), "http": HttpConfig(port=0)}
    return EdgeConfig.model_validate(places | {"axes": (axis,)} | changes)


def two_axes(**changes: object) -> EdgeConfig:
    config = config_of("simulated", {"scenario": "healthy"}, **changes)
    axis = config.axes[0]
    return config.model_copy(update={"axes": (axis, axis.model_copy(update={"name": "Y"}))})


def estimated(make: Callable[[], PreloadEstimator]) -> EstimatedAxis:
    """Axis X, estimated; an error that its estimator raises fails the test."""

    def fail(error: Exception) -> str:
        raise AssertionError from error

    return EstimatedAxis("X", make, fail, lambda _reason: None)


class Running:
    """A service inside the test's event loop."""

    def __init__(
        self, context: NodeContext, address: asyncio.Future[str], task: "asyncio.Task[None]"
    ) -> None:
        self.context, self.bus = context, context.bus
        self.address = address
        self.task = task


@cache
def warm() -> None:
    """Compile the kernels, which may take longer than anybody here waits."""
    names = ("machine.toml", "commissioned.toml")
    warm_up(EstimatorConfig(), (load_machine(DEFAULT_MACHINE.with_name(each)) for each in names))


@asynccontextmanager
async def running(
    config: EdgeConfig, names: tuple[str, ...] = PIPELINE, *, until_sources_end: bool = False
) -> AsyncIterator[Running]:
    """Run nodes on a bus of their own, with kernels that are compiled: nobody waits for that."""
    if {"downsample", "estimate"} & {*names}:
        await asyncio.to_thread(warm)
    bus = await Bus.open(BusSettings(config.bus.endpoint, "router"))
    address: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    stop = asyncio.Event()

    def on_ready(url: str) -> None:
        if not address.done():  # a server that was begun again tells it again
            address.set_result(url)

    context = NodeContext(config, bus, on_ready, is_replay=until_sources_end)
    task = asyncio.create_task(run_nodes(context, names, stop))
    try:
        yield Running(context, address, task)
    finally:
        stop.set()
        await asyncio.wait([task])
        await bus.close()


@asynccontextmanager
async def served(
    config: EdgeConfig, names: tuple[str, ...] = PIPELINE
) -> AsyncIterator[tuple[Running, httpx.AsyncClient]]:
    """Run nodes, and a client of their page."""
    async with running(config, names) as service:
        address = await asyncio.wait_for(service.address, PATIENCE_S)
        async with httpx.AsyncClient(base_url=address, timeout=PATIENCE_S) as client:
            yield service, client


async def until(probe: Callable[[], Any], patience_s: float = PATIENCE_S) -> Any:
    """The first true answer of `probe`, which may have to be awaited; fails after a while."""
    async with asyncio.timeout(patience_s):
        while True:
            answer = probe()
            if answer := await answer if isawaitable(answer) else answer:
                return answer
            await asyncio.sleep(0.01)


async def once(
    client: Any, path: str, probe: Callable[[Any], Any], patience_s: float = PATIENCE_S
) -> Any:
    """Result of a probe on the first answer of the interface that holds it."""

    async def answer() -> Any:
        response = await client.get(f"api/v1/{path}")
        return response.status_code == 200 and probe(response.json())

    return await until(answer, patience_s)


async def reported(
    service: Running, component: str, status: ComponentStatus, axis: str | None = None
) -> ComponentHealth:
    """The first report of a component, of one axis, that shows a status."""
    keys = service.context.config.keys
    reports = service.bus.subscribe(keys.all_components(STATUS), STATUS, depth=4096)
    async with asyncio.timeout(PATIENCE_S):
        async for _, _, each in reports:
            if (each.component, each.axis, each.status) == (component, axis, status):
                return each
    raise AssertionError


async def done(client: Any, path: str, command: dict[str, str], key: str) -> Any:
    """Answer to a command once it is done and kept, asked again with the same key until then.

    Until health is up nobody answers (503), and a disk may be too slow for its patience (507).
    """

    async def accepted() -> Any:
        answer = await client.post(path, json=command, headers={"idempotency-key": f'"{key}"'})
        assert answer.status_code in (202, 503, 507), answer.text
        return answer if answer.status_code == 202 else None

    return await until(accepted)


def production(
    machine: Machine, percent: float | Floats, rows: int, *effects: str, seed: int = 1
) -> SampleFrame:
    """Production motion of the simulated axis at a preload, one or one a row, at 1 kHz."""
    limits = motion_limits(machine)
    segments = MOTIONS["production"](limits, np.random.default_rng(seed))
    setpoints = Setpoints(segments, limits.low_m, RATE_HZ).take(rows)
    settings = FeedDriveSettings.of_machine(machine, RATE_HZ, [parse_effect(e) for e in effects])
    each = np.broadcast_to(np.asarray(percent, dtype=np.float64), (rows,))
    return FeedDrive(settings, limits.low_m, float(each[0]), seed).advance(setpoints, each)


@pytest.fixture
async def bus() -> AsyncIterator[Bus]:
    made = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    yield made
    await made.close()


@pytest.fixture(scope="session")
def trace_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty seconds of production motion at 6.85 % as a trace file."""
    frame = production(load_machine(DEFAULT_MACHINE), 6.846, 20_000)
    path = tmp_path_factory.mktemp("trace") / "healthy.csv"
    with TraceWriter(path, tuple(frame.channels)) as writer:
        writer.write(frame)
    return path
