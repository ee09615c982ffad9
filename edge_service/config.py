"""The service's configuration and machine files: read, checked, every mistake told by its key."""

import difflib
import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from .messages.addresses import is_loopback, split_endpoint
from .messages.keys import MachineKeys, check_part
from .models.machine import Machine

DEFAULT_CONFIG = Path(__file__).parent / "defaults" / "edge.toml"
DEFAULT_MACHINE = Path(__file__).parent / "defaults" / "machine.toml"
FILE_KEYS = ("path", "folder", "certificate", "private_key", "server_certificate", "ledger")
"""Keys of drivers that name files or folders."""
_Model = TypeVar("_Model", bound=BaseModel)


class ConfigError(Exception):
    """A file or key that is wrong; the text is one line."""


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class ServiceConfig(_Table):
    """`[service]`: who we are on the bus."""

    site: str = "bench"
    machine: str = "lfd"

    @field_validator("site", "machine")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)


class BusConfig(_Table):
    """`[bus]`: the loopback endpoint at which the bus listens."""

    endpoint: str = "tcp/127.0.0.1:7447"

    @field_validator("endpoint")
    @classmethod
    def _loopback(cls, value: str) -> str:
        split_endpoint(value)
        return value


class HttpConfig(_Table):
    """`[http]`: where the API and the page are served; loopback only. Port 0 takes a free one."""

    host: str = "127.0.0.1"
    port: int = Field(8080, ge=0, le=65535)

    @field_validator("host")
    @classmethod
    def _loopback(cls, value: str) -> str:
        if not is_loopback(value):
            raise ValueError(
                f"{value!r}: only loopback addresses are allowed until TLS and roles exist"
            )
        return value


class DownsampleConfig(_Table):
    """`[downsample]`: length of an interval."""

    interval_s: float = Field(0.1, ge=0.001, le=10.0)


class EstimatorConfig(_Table):
    """`[estimator]`: `auto` is `fused` where the machine file is commissioned, else `kf-imm`."""

    method: Literal["auto", "fused", "kf-imm", "sif-imm"] = "auto"
    engine: Literal["compiled", "filterpy"] = "compiled"
    activation_exponent: float = Field(1.33, ge=1.0, le=8.0)
    window_s: float = Field(1.0, ge=0.0, le=3600.0)

    @model_validator(mode="after")
    def _engine_fits(self) -> "EstimatorConfig":
        if self.engine == "filterpy" and self.method != "kf-imm":
            raise ValueError("engine 'filterpy' has Kalman filters only; set method = 'kf-imm'")
        return self


class HealthConfig(_Table):
    """`[health]`: limits of the axis condition, in percent of the fresh screw's preload."""

    warning_percent_of_fresh: float = Field(60.0, gt=0.0, le=100.0)
    fault_percent_of_fresh: float = Field(30.0, gt=0.0, le=100.0)

    @model_validator(mode="after")
    def _ordered(self) -> "HealthConfig":
        if self.fault_percent_of_fresh >= self.warning_percent_of_fresh:
            raise ValueError("fault_percent_of_fresh must lie below warning_percent_of_fresh")
        return self


class MqttConfig(_Table):
    """`[mqtt]`: where answers are sent besides; nothing is sent without it.

    Attributes:
        prefix: first part of every topic, `{prefix}/{site}/{machine}/{axis}/{preload|...}`.
        period_s: at most one preload estimate per axis in this time; health and events all go.
        buffer: file in which messages wait while the broker is away.
        buffer_messages: how many of them; then the oldest go.
    """

    host: str
    port: int = Field(1883, ge=1, le=65535)
    prefix: str = "feeddrive"
    user: str | None = None
    password: str | None = None
    ca_certificate: Path | None = None
    period_s: float = Field(1.0, ge=0.0, le=3600.0)
    buffer: Path = Path("mqtt-buffer.sqlite")
    buffer_messages: int = Field(1_000_000, ge=1)

    @model_validator(mode="after")
    def _check(self) -> "MqttConfig":
        if any(sign in self.prefix for sign in "+#$") or not self.prefix.strip("/"):
            raise ValueError(f"prefix {self.prefix!r}: expected a topic without +, # and $")
        if self.password is not None and self.user is None:
            raise ValueError("user: missing, there is a password")
        if self.user is not None and self.ca_certificate is None and not is_loopback(self.host):
            raise ValueError("user: needs ca_certificate, or the password could be read")
        return self


class VibrationConfig(_Table):
    """`[vibration]`: fast sensors reduced to features; without it their signals are dropped.

    Attributes:
        interval_s: one set of features per interval.
        bands_hz: name -> lower and upper frequency.
        orders: name -> order per revolution of the screw; balls slip by up to `slip` of it.
        keep_folder: where the raw signal around an event is kept; it is dropped without.
        keep_before_s, keep_after_s: how much of it.
    """

    interval_s: float = Field(1.0, ge=0.05, le=60.0)
    bands_hz: dict[str, tuple[float, float]] = {"low": (10.0, 1000.0), "high": (1000.0, 5000.0)}
    orders: dict[str, float] = {"screw": 1.0, "ball_pass": 9.56}
    slip: float = Field(0.02, ge=0.0, le=0.2)
    keep_folder: Path | None = None
    keep_before_s: float = Field(5.0, ge=0.0, le=600.0)
    keep_after_s: float = Field(5.0, ge=0.0, le=600.0)

    @model_validator(mode="after")
    def _check(self) -> "VibrationConfig":
        for name, (low, high) in self.bands_hz.items():
            if not 0.0 <= low < high:
                raise ValueError(f"bands_hz.{name}: [{low:g}, {high:g}], expected low below high")
        for name, order in self.orders.items():
            if not order > 0.0:
                raise ValueError(f"orders.{name}: {order:g}, expected more than 0")
        return self


class HistoryConfig(_Table):
    """`[history]`: where history, events and the state of alarms and trends are kept."""

    folder: Path | None = None
    budget_mb: float = Field(2000.0, ge=10.0)


class AlarmsConfig(_Table):
    """`[alarms]`: what calls a person; percent of the fresh screw's preload."""

    rate_percent_per_1000_h: float = Field(20.0, gt=0.0)
    sudden_drop_percent: float = Field(15.0, gt=0.0, le=100.0)
    sudden_drop_within_s: float = Field(10.0, gt=0.0, le=3600.0)
    model_nis: float = Field(6.0, gt=1.0)
    raise_delay_s: float = Field(0.0, ge=0.0, le=3600.0)
    clear_delay_s: float = Field(5.0, ge=0.0, le=3600.0)
    data_lost_after_s: float = Field(5.0, ge=0.0, le=3600.0)


class WebhookConfig(_Table):
    """`[webhook]`: where events are posted to; nothing is sent without a `url`."""

    url: str | None = Field(None, pattern=r"^https?://")
    secret_file: Path | None = None
    kinds: tuple[str, ...] = ("alarm_raised", "alarm_cleared", "condition_changed")

    @model_validator(mode="after")
    def _signed(self) -> "WebhookConfig":
        if self.url is not None and self.secret_file is None:
            raise ValueError("url needs a secret_file: what is sent is signed with it")
        return self


class AxisConfig(_Table):
    """`[[axes]]`: one axis, its machine file and its driver."""

    name: str
    machine: Path = DEFAULT_MACHINE
    driver: str = "simulated"
    settings: dict[str, Any] = {}

    @field_validator("name")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)


class EdgeConfig(_Table):
    """The whole configuration file."""

    service: ServiceConfig = ServiceConfig()
    bus: BusConfig = BusConfig()
    http: HttpConfig = HttpConfig()
    downsample: DownsampleConfig = DownsampleConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    health: HealthConfig = HealthConfig()
    mqtt: MqttConfig | None = None
    vibration: VibrationConfig | None = None
    alarms: AlarmsConfig = AlarmsConfig()
    webhook: WebhookConfig = WebhookConfig()
    history: HistoryConfig = HistoryConfig()
    axes: tuple[AxisConfig, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _unique_axes(self) -> "EdgeConfig":
        names = [axis.name for axis in self.axes]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"axes: two axes are named {name!r}")
        return self

    @property
    def keys(self) -> MachineKeys:
        """Keys of this machine on the bus."""
        return MachineKeys(self.service.site, self.service.machine)


def load_config(path: Path) -> EdgeConfig:
    """Read and check a configuration file; paths in it are relative to its folder.

    Raises:
        ConfigError: one line with the file, the key, what was wrong and what was expected.
    """
    config = _checked(EdgeConfig, _read_toml(path), path)
    axes = tuple(
        axis.model_copy(
            update={
                "machine": path.parent / axis.machine,
                "settings": _anchored(axis.settings, path.parent),
            }
        )
        for axis in config.axes
    )
    folder = path.parent
    placed = {
        "axes": axes,
        "history": _placed(config.history, "folder", folder),
        "webhook": _placed(config.webhook, "secret_file", folder),
        "mqtt": _placed(_placed(config.mqtt, "buffer", folder), "ca_certificate", folder),
        "vibration": _placed(config.vibration, "keep_folder", folder),
    }
    return config.model_copy(update=placed)


def load_machine(path: Path) -> Machine:
    """Read and check a machine file. Raises ConfigError like `load_config`."""
    machine = _checked(Machine, _read_toml(path), path)
    if machine.effects:
        from .models.effects.registry import machine_effects

        try:
            machine_effects(machine)
        except ValueError as error:
            raise ConfigError(f"{path}: effects: {error}") from None
    return machine


def check_settings(model: type[_Model], settings: dict[str, Any], where: str) -> _Model:
    """Check a driver's settings; ConfigError names the key below `where`."""
    try:
        return model.model_validate(settings)
    except ValidationError as error:
        raise ConfigError(f"{where}.{explain(error, model)}") from None


def _placed(table: _Table | None, key: str, folder: Path) -> _Table | None:
    """A path in a table is relative to the configuration file."""
    path = None if table is None else getattr(table, key)
    if table is None or path is None:
        return table
    return table.model_copy(update={key: folder / path})


def _anchored(settings: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Files that a driver is told of are relative to the configuration file, too."""
    files = {key: settings[key] for key in FILE_KEYS if isinstance(settings.get(key), str)}
    return settings | {key: str(folder / name) for key, name in files.items()}


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        with path.open("rb") as file:
            return tomllib.load(file)
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: no TOML: {error}") from None


def _checked(model: type[_Model], content: dict[str, Any], path: Path) -> _Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{path}: {explain(error, model)}") from None


def explain(error: ValidationError, model: type[BaseModel]) -> str:
    """The first mistake of a validation as one line, `key: what was wrong`."""
    details = error.errors(include_url=False)
    first = details[0]
    location = _key_path(first["loc"])
    if first["type"] == "extra_forbidden":
        problem = "unknown key" + _closest(first["loc"], model)
    elif first["type"] == "missing":
        problem = "missing"
    else:
        problem = first["msg"].removeprefix("Value error, ")
        if first["type"] != "value_error":
            problem += f" (got {first['input']!r})"
    more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    return f"{location}: {problem}{more}" if location else f"{problem}{more}"


def _key_path(location: tuple[int | str, ...]) -> str:
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}"
    return path.removeprefix(".")


def _closest(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """A hint at the known key that was perhaps meant."""
    known = {name for table in _tables(model) for name in table.model_fields}
    near = difflib.get_close_matches(str(location[-1]), sorted(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def _tables(model: type[BaseModel]) -> list[type[BaseModel]]:
    tables = [model]
    for field in model.model_fields.values():
        for candidate in (field.annotation, *getattr(field.annotation, "__args__", ())):
            if isinstance(candidate, type) and issubclass(candidate, BaseModel):
                tables += _tables(candidate)
    return tables
