"""A recording that goes through a real broker gives the numbers of `estimate` on the file."""

import asyncio
import csv
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np

from drivers.base import DriverContext
from drivers.mqtt.driver import MqttDriver
from drivers.mqtt.link import MqttSourceConfig
from drivers.mqtt.stub import MqttStub
from drivers.stub import StubAxis
from edge_service.config import DEFAULT_MACHINE, EdgeConfig, load_machine
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.samples import Floats
from edge_service.messages.topics import PRELOAD
from edge_service.nodes.stub_node import driven
from edge_service.offline.estimate import OfflineEstimate
from edge_service.offline.recordings import open_recording
from edge_service.recordings.reader import read_trace

from ..drivers.mqtt.bench import TOPIC
from ..drivers.mqtt.broker import Broker, needs_broker
from ..recordings.form_files import EDGE_NAMES
from .conftest import PATIENCE_S, config_of, running

pytestmark = needs_broker
MACHINE_FILE = DEFAULT_MACHINE.with_name("commissioned.toml")
MACHINE = load_machine(MACHINE_FILE, 1)
ROWS = 9_960  # the last of them complete an interval, and no block of the capture


def begun_anew(rows: Floats) -> Floats:
    """Counts that begin anew: inside an interval, and where one ends."""
    rows[2513:, 0] -= 2000.0
    rows[4102:, 0] -= 1234.0
    return rows


def control_rows(trace: Path) -> Floats:
    """Every second sample of a trace in the units of the control, with its count."""
    channels = read_trace(trace).channels
    turned_m = MACHINE.transmission_ratio_m_per_rad * channels["motor_angle_rad"]
    values = [1e3 * turned_m, 1e3 * channels["table_position_m"], channels["torque_command_nm"]]
    rows = np.column_stack([5000.0 + np.arange(len(turned_m[::2])), *(v[::2] for v in values)])
    return rows[:ROWS]


def write_recording(path: Path, rows: Floats) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["CYCLE", *EDGE_NAMES])
        writer.writerows([repr(v) if np.isfinite(v) else "" for v in row] for row in rows.tolist())
    return path


@asynccontextmanager
async def played(recording: Path, config: MqttSourceConfig) -> AsyncIterator[None]:
    """The stub's own count, as fast as it can."""
    context = DriverContext("X", MACHINE)
    source = driven("replay", {"path": recording, "speed": 0.0}, context)
    stub = MqttStub([StubAxis("X", config, context, source)])
    await stub.start()
    try:
        yield
    finally:
        await stub.close()


def on_file(recording: Path, config: EdgeConfig) -> list[PreloadEstimate]:
    with open_recording(MACHINE, recording) as frames:
        return list(OfflineEstimate(MACHINE, config.estimator).estimates(frames))


async def live(recording: Path, config: EdgeConfig, blocks: int) -> Any:
    """Estimates of the service whose driver hears the broker."""
    source = MqttSourceConfig.model_validate(config.axes[0].settings)
    driver = MqttDriver(source, DriverContext("X", MACHINE))  # which the broker knows from now on
    await driver.open()
    await driver.close()
    async with running(config, ("estimate", "downsample", "acquire")) as service:
        subscriber = service.bus.subscribe(config.keys.key("X", PRELOAD), PRELOAD)
        try:
            async with played(recording, source), asyncio.timeout(PATIENCE_S):
                heard = aiter(subscriber)
                return [(await anext(heard))[2] for _ in range(blocks)]
        finally:
            subscriber.close()


def numbers(estimate: PreloadEstimate) -> list[float]:
    """Time, preload and drag with their intervals; NaN for what is not said."""
    drag = estimate.drag_torque_nm
    said = [estimate.time_s, estimate.preload_percent, estimate.low, estimate.high]
    said += [None] * 3 if drag is None else [drag.value, drag.low, drag.high]
    return [np.nan if each is None else each for each in said]


async def test_the_numbers_are_those_of_the_file(trace_path: Path, tmp_path: Path) -> None:
    recording = write_recording(tmp_path / "recorded.csv", begun_anew(control_rows(trace_path)))
    broker = Broker(tmp_path)
    await broker.start()
    try:
        settings = {"url": f"mqtt://127.0.0.1:{broker.port}", "topic": TOPIC}
        config = config_of("mqtt", settings, MACHINE_FILE)
        expected = on_file(recording, config)
        heard = await live(recording, config, len(expected))
    finally:
        await broker.stop()
    assert sum(each.status is EstimateStatus.ESTIMATED for each in expected) > 100
    assert [each.status for each in heard] == [each.status for each in expected]
    assert [each.reasons for each in heard] == [each.reasons for each in expected]
    np.testing.assert_allclose(
        list(map(numbers, heard)), list(map(numbers, expected)), rtol=1e-9, equal_nan=True
    )
