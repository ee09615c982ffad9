"""The whole configuration: tables of the service, and what must hold between them."""

from pathlib import Path
from typing import Any, Literal, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator
from pydantic_core import PydanticCustomError

from .. import DEFAULTS
from ..config_tables import (
    AlarmsConfig,
    StoreConfig,
    Table,
    VibrationConfig,
)
from ..estimate.interface import AUTO, ESTIMATORS
from ..messages.addresses import is_http_url, is_loopback, split_endpoint
from ..messages.keys import MachineKeys, check_component, check_part

DEFAULT_MACHINE = DEFAULTS / "machine.toml"


class ServiceConfig(Table):
    """`[service]`: who we are on the bus."""

    site: str = "bench"
    machine: str = "lfd"

    @field_validator("site", "machine")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)


class BusConfig(Table):
    """`[bus]`: where the bus listens."""

    # `tcp/<loopback address>:<port>`. In `run` others may read there
    endpoint: str = "tcp/127.0.0.1:7447"
    # Zenoh's own configuration (JSON5), passed through: TLS, access control, routers
    zenoh_file: Path | None = None

    @field_validator("endpoint")
    @classmethod
    def _loopback(cls, value: str) -> str:
        split_endpoint(value)
        return value


class HttpConfig(Table):
    """`[http]`: where the API and the page are served. Port 0 takes a free one."""

    host: str = "127.0.0.1"
    port: int = Field(8080, ge=0, le=65535)
    url: str | None = None  # address of a proxy that passes on to us: its host name is let in
    # certificate, private_key: of the server, in PEM: TLS with them
    certificate: Path | None = None
    private_key: Path | None = None

    @property
    def needs_token(self) -> bool:
        """Others than loopback reach the service, so that nobody is let in without a token."""
        return self.url is not None or not is_loopback(self.host)

    @field_validator("url")
    @classmethod
    def _http(cls, value: str | None) -> str | None:
        if value is not None and not is_http_url(value):
            raise ValueError("expected http://HOST[:PORT][/PATH] or https://...")
        return value

    @model_validator(mode="after")
    def _guarded(self) -> "HttpConfig":
        if (self.certificate is None) != (self.private_key is None):
            lone = "private_key" if self.private_key is None else "certificate"
            raise ValueError(f"{lone}: missing; certificate and private_key are needed together")
        if self.certificate is None and not is_loopback(self.host):
            raise ValueError(
                f"{self.host!r} is not a loopback address: it needs certificate and private_key"
            )
        return self


class EstimatorConfig(Table):
    """`[estimator]`: `auto` takes the first method of the registry that suits the machine file.

    `engine` is that of the thesis' Kalman filters, which give a second opinion beside any method.
    """

    method: str = AUTO
    engine: Literal["compiled", "filterpy"] = "compiled"

    @field_validator("method", mode="before")
    @classmethod
    def _known_method(cls, value: object) -> object:
        *names, last = (repr(name) for name in (AUTO, *ESTIMATORS))
        if value not in (AUTO, *ESTIMATORS):
            expected = f"Input should be {', '.join(names)} or {last}"
            raise PydanticCustomError("literal_error", "{expected}", {"expected": expected})
        return value


class _OfFile(Table):
    """Table that knows where it was read."""

    _file: Path | None = PrivateAttr(None)

    def of_file(self, path: Path) -> Self:
        self._file = path
        return self

    @property
    def file(self) -> Path | None:
        return self._file

    def place_of(self, table: str) -> str:
        """A table after the file that it was read from: for mistakes in it."""
        return table if self._file is None else f"{self._file}: {table}"


class AxisConfig(_OfFile):
    """`[[axes]]`: one axis, its machine file and its driver."""

    name: str
    machine: Path = DEFAULT_MACHINE
    driver: str = "simulated"
    # warning_percent, fault_percent: those of `[alarms]` unless given
    warning_percent: float | None = Field(None, gt=0.0, le=100.0)
    fault_percent: float | None = Field(None, gt=0.0, le=100.0)
    settings: dict[str, Any] = {}
    _number: int | None = PrivateAttr(None)

    @field_validator("name")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)

    @property
    def number(self) -> int | None:
        """The controller's number of the axis, in place of the machine file's."""
        return self._number

    def numbered(self, number: int | None) -> "AxisConfig":
        """The same axis under another number of the controller."""
        self._number = number
        return self

    @property
    def place(self) -> str:
        """Table of the axis, after the file that it was read from: for mistakes in it."""
        return self.place_of(f"axes.{self.name}")


class AxisFile(Table):
    """`axes/{axis}/axis.toml` in the state folder: the table of an axis that was made on the page.

    The name of its folder is that of the axis.
    """

    axes: tuple[AxisConfig]


class EdgeConfig(_OfFile):
    """The whole configuration file."""

    service: ServiceConfig = ServiceConfig()
    bus: BusConfig = BusConfig()
    http: HttpConfig = HttpConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    outputs: dict[str, dict[str, Any]] = {}
    vibration: VibrationConfig = VibrationConfig()
    alarms: AlarmsConfig = AlarmsConfig()
    store: StoreConfig = StoreConfig()
    axes: tuple[AxisConfig, ...] = ()
    _digest: str = PrivateAttr("")

    @model_validator(mode="after")
    def _axes_fit(self) -> "EdgeConfig":
        self.check_axes()
        return self

    def check_axes(self) -> None:
        """Check what must hold between axes, and with `[alarms]`. Raises ValueError."""
        names = [axis.name for axis in self.axes]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"axes: two axes are named {name!r}")
            warning, fault = self.limits_percent(name)
            if fault >= warning:
                raise ValueError(f"axes.{name}: fault_percent must lie below warning_percent")

    def with_axis(self, axis: AxisConfig) -> "EdgeConfig":
        """The same with one more axis, or with this one in place of another. Raises ValueError."""
        axes = {each.name: each for each in self.axes} | {axis.name: axis}
        changed = self.model_copy(update={"axes": tuple(axes.values())})
        changed.check_axes()
        return changed

    @field_validator("outputs")
    @classmethod
    def _names(cls, value: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for name in value:
            check_component(name)
        return value

    def of_digest(self, digest: str) -> "EdgeConfig":
        """The same configuration, which knows the digest of what it was read from."""
        self._digest = digest
        return self

    @property
    def digest(self) -> str:
        """Short, hexadecimal, equal wherever the content of all files is equal; empty without."""
        return self._digest

    def limits_percent(self, axis: str) -> tuple[float, float]:
        """Limits of warning and fault of an axis, percent of the fresh screw's preload."""
        own = next(each for each in self.axes if each.name == axis)
        return (
            own.warning_percent or self.alarms.warning_percent,
            own.fault_percent or self.alarms.fault_percent,
        )

    @property
    def keys(self) -> MachineKeys:
        """Keys of this machine on the bus."""
        return MachineKeys(self.service.site, self.service.machine, tuple(self.outputs))
