"""A service state and its application, with a clock that the test moves."""

from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from fastapi import FastAPI

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.config_tables import AlarmsConfig
from edge_service.health.condition import limits_of
from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import create_app
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import AxisHealth, ComponentHealth, ComponentStatus
from edge_service.messages.interval import Interval
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TIME, TORQUE
from edge_service.offline.simulate import SimulationSettings, simulate

from ..bench.real_machines import written
from ..messages.examples import event_of

NS = 1_000_000_000
START_NS = 1_769_860_800 * NS  # 2026-01-31T12:00:00Z
ESTIMATE = PreloadEstimate(
    time_s=12.0,
    status=EstimateStatus.ESTIMATED,
    preload_percent=6.71,
    low=6.58,
    high=6.84,
    preload_n=500.1,
    drag_torque_nm=Interval(value=0.141, low=0.139, high=0.143),
    stiffness_n_per_m=Interval(value=3.6e7, low=3.4e7, high=3.8e7),
    mode_probability={"10": 0.0, "7.5": 0.9, "5": 0.1},
    nis=1.1,
)


@dataclass
class Scene:
    """A service with the axes X (fresh preload 10 %) and Y (limits unknown)."""

    now_ns: int = START_NS
    sequence: int = 0

    def __post_init__(self) -> None:
        axes = {"X": limits_of(AlarmsConfig(), 10.0), "Y": None}
        self.state = ServiceState(axes, self.now_ns)
        self.app = create_app(self.state, lambda: self.now_ns)

    def wait(self, seconds: float) -> None:
        self.now_ns += round(seconds * NS)

    def header(self) -> Header:
        self.sequence += 1
        return Header(self.sequence, START_NS, self.now_ns, self.now_ns)

    def hear_preload(self, axis: str = "X", **changes: object) -> None:
        estimate = ESTIMATE.model_copy(update=changes)
        self.state.on_preload(axis, self.header(), estimate, self.now_ns)

    def hear_health(
        self, axis: str = "X", condition: AxisCondition = AxisCondition.NORMAL, **more: object
    ) -> None:
        members = {"axis": axis, "condition": condition, "since_time_ns": START_NS} | more
        health = AxisHealth.model_validate(members)
        self.state.on_health(self.header(), health, self.now_ns)

    def hear_component(self, component: str = "http", **more: object) -> None:
        members = {"component": component, "status": ComponentStatus.OK} | more
        self.state.on_component(ComponentHealth.model_validate(members), self.now_ns)

    def hear_event(self, message: str, axis: str = "X") -> int:
        members = {"kind": "condition_changed", "level": AxisCondition.WARNING}
        event = event_of(message, axis=axis, time_ns=self.now_ns, **members)
        for logged in self.state.events.add((event,), self.now_ns):
            self.state.readers.put_event(logged)
        return self.state.events.last_id()

    def hear_all(self) -> None:
        """Both axes are well."""
        for axis in self.state.axes:
            self.hear_preload(axis)
            self.hear_health(axis)


@pytest.fixture
def scene() -> Scene:
    """A service that has heard nothing yet."""
    return Scene()


def foreign_recording(path: Path, duration_s: float) -> None:
    """Write the bench's axis as a control might: a current, and a misleading name of the table."""
    settings = SimulationSettings(duration_s=duration_s, seed=5)
    simulate(load_machine(DEFAULT_MACHINE), settings, path)
    own = np.genfromtxt(path, delimiter=",", names=True)
    columns = {"Zeit [ms]": 1e3 * own[TIME], "Strom [A]": own[TORQUE] / 1.2}
    columns |= {"Winkel [deg]": np.degrees(own[ANGLE]), "Soll [mm]": 1e3 * own[TABLE_POSITION]}
    written(path, columns)


def client_of(app: FastAPI, url: str = "http://127.0.0.1", **how: Any) -> httpx.AsyncClient:
    return httpx.AsyncClient(transport=httpx.ASGITransport(app, **how), base_url=url)


@pytest.fixture
async def client(scene: Scene) -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(scene.app, raise_app_exceptions=False) as client:
        yield client
