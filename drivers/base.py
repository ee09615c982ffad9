"""The one protocol between a machine and the service.

A driver reads a machine and yields sample frames; it never publishes, never knows the bus and never
knows another driver. It is found by its name in the entry-point group `edge_service.drivers`, which
points to its class.
"""

from collections.abc import AsyncGenerator
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

from pydantic import BaseModel, ConfigDict

from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine
from edge_service.plugins import MisconfiguredError, load_plugin, plugins

ENTRY_POINT_GROUP = "edge_service.drivers"
DriverMisconfiguredError = MisconfiguredError
QUIET_S = 10.0  # silence of a source after which `no data` is told, s


class DriverConfig(BaseModel):
    """Base of every driver's configuration: unknown keys are refused.

    A secret is a `SecretStr`; with a key `x_file` beside it, a `Path`, its user may keep it in a
    file of its own, and the driver finds it under `x` all the same.
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, hide_input_in_errors=True
    )


class DriverUnavailableError(Exception):
    """The machine cannot be reached now; trying again later may help."""


@dataclass(frozen=True, slots=True)
class DriverContext:
    """Name and machine file of the axis that a driver serves, and for whom."""

    axis: str
    machine: Machine
    service: str = ""  # root of its keys on the bus, which ends with site and machine
    installation: str = ""  # file of the configuration


@dataclass(frozen=True, slots=True)
class Probe:
    """Channels, rate and description of a source, without starting to read."""

    description: str
    channels: tuple[str, ...]
    rate_hz: float | None


class Driver(Protocol):
    """One axis of one machine.

    `open` and `close` may be called in any order and twice; `frames` ends when the source ends
    (a recording) or raises DriverUnavailableError when it is lost. After `close`, `open` starts
    afresh. Waiting for the next frame is never ended from outside: a machine may be silent. A
    driver whose source is rightly silent for longer than `QUIET_S` has a `quiet_s` of its own, and
    one whose samples may come late, all at once, a `lag_s`: how late the newest ones are.
    """

    config_model: ClassVar[type[DriverConfig]]
    paced: bool
    """Pace: whether `frames` keeps time by itself; if not, the caller sets the pace."""

    @property
    def counters(self) -> dict[str, int]:
        """Monotonic counts worth seeing, e.g. bad cells; may be empty."""

    @property
    def readings(self) -> dict[str, float]:
        """Values worth seeing that are no samples; may be empty."""

    def __init__(self, config: Any, context: DriverContext) -> None: ...

    async def open(self) -> None:
        """Connect. Raises DriverUnavailableError or DriverMisconfiguredError."""

    def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Sample frames in the order in which they were taken.

        Every frame of a source holds the same channels. A value that is not good has its code in
        the frame's `quality`, and is NaN if it is bad.
        """

    async def probe(self) -> Probe:
        """Say what there is to read. Raises like `open`."""

    async def close(self) -> None:
        """Let go of everything."""


def driver_names() -> list[str]:
    return list(plugins(ENTRY_POINT_GROUP))


def load_driver(name: str) -> type[Driver]:
    """The class of a driver. Raises UnknownPluginError."""
    found: type[Driver] = load_plugin(ENTRY_POINT_GROUP, name)
    return found
