"""The service's configuration and machine files: read, checked, every mistake told by its key."""

import difflib
import logging
import re
import tomllib
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import BaseModel, Field, ValidationError, field_validator, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from .config_secrets import open_secrets, secret_keys, with_secrets, with_table_secrets
from .config_tables import (
    AlarmsConfig,
    EmailConfig,
    EventOutputConfig,
    FleetConfig,
    HistoryConfig,
    JobsConfig,
    MqttConfig,
    MtconnectConfig,
    OpcuaConfig,
    Table,
    VibrationConfig,
    WebhookConfig,
)
from .estimate.registry import AUTO, ESTIMATORS
from .messages.addresses import Security, is_loopback, split_endpoint
from .messages.keys import MachineKeys
from .messages.names import check_part
from .messages.outputs import OF_HTTP
from .models.machine import Machine
from .secret_files import SecretError, secret_path

log = logging.getLogger(__name__)
DEFAULT_CONFIG = Path(__file__).parent / "defaults" / "edge.toml"
DEFAULT_MACHINE = Path(__file__).parent / "defaults" / "machine.toml"
BROKER_FILES = ("ca_certificate", "client_certificate", "client_key")
MQTT_FILES = ("buffer", *BROKER_FILES)
_OF_SECURITY = ("certificate", "private_key", "server_certificate")
FILE_KEYS = ("path", "folder", *_OF_SECURITY, "ledger", *BROKER_FILES)
"""Keys of drivers that name files or folders."""
_Model = TypeVar("_Model", bound=BaseModel)
_DEEP = re.compile(rb"(?:[\[{]\s*){100}")


class ConfigError(Exception):
    """A file or key that is wrong; the text is one line."""


class ServiceConfig(Table):
    """`[service]`: who we are on the bus."""

    site: str = "bench"
    machine: str = "lfd"

    @field_validator("site", "machine")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)


class BusConfig(Table):
    """`[bus]`: where the bus listens, and who may do what there.

    Attributes:
        endpoint: `tcp/<loopback address>:<port>`, where any process of this machine may read.
        security: `readers`: only with a certificate of a node may one publish; `tls`: only with a
            certificate may one read; `open`: whoever connects to `endpoint` may publish anything.
        certificates: folder that `edge-service certs` has made; without it nodes in processes of
            their own make theirs, for their user alone.
        tls_endpoint: where those with certificates take part; the port after that of `endpoint`
            unless stated.
    """

    endpoint: str = "tcp/127.0.0.1:7447"
    security: Security = "readers"
    certificates: Path | None = None
    tls_endpoint: str | None = None

    @field_validator("endpoint")
    @classmethod
    def _loopback(cls, value: str) -> str:
        return _endpoint(value, "tcp")

    @field_validator("tls_endpoint")
    @classmethod
    def _encrypted(cls, value: str | None) -> str | None:
        return None if value is None else _endpoint(value, "tls")

    @model_validator(mode="after")
    def _certified(self) -> "BusConfig":
        if self.security == "tls" and self.certificates is None:
            raise ValueError('certificates: missing, security = "tls" needs them')
        if self.security == "open" and self.certificates is not None:
            raise ValueError('certificates: without meaning with security = "open"')
        return self

    @property
    def secure_endpoint(self) -> str:
        """The endpoint for those with certificates."""
        if self.tls_endpoint is not None:
            return self.tls_endpoint
        host, port = split_endpoint(self.endpoint)
        return f"tls/{host}:{port + 1 if port else 0}"


def _endpoint(value: str, protocol: str) -> str:
    split_endpoint(value)
    if not value.startswith(f"{protocol}/"):
        raise ValueError(f"{value!r}: expected an endpoint of the form {protocol}/127.0.0.1:7447")
    return value


class HttpConfig(Table):
    """`[http]`: where the API and the page are served. Port 0 takes a free one.

    Attributes:
        certificate, private_key: of the server, in PEM: TLS with them.
        tokens_file: who may do what, made by `edge-service token`; without it whoever reaches the
            service may do anything.
        allowed_hosts: host names, without port, by which it is addressed besides loopback.
    """

    host: str = "127.0.0.1"
    port: int = Field(8080, ge=0, le=65535)
    connections: int = Field(256, ge=4, le=10_000)
    certificate: Path | None = None
    private_key: Path | None = None
    tokens_file: Path | None = None
    allowed_hosts: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _guarded(self) -> "HttpConfig":
        if (self.certificate is None) != (self.private_key is None):
            lone = "private_key" if self.private_key is None else "certificate"
            raise ValueError(f"{lone}: missing, the two go together")
        needed = ("certificate", "private_key", "tokens_file")
        missing = [name for name in needed if getattr(self, name) is None]
        if missing and not is_loopback(self.host):
            raise ValueError(
                f"{self.host!r} is no loopback address: it needs {', '.join(missing)}"
                " (`edge-service certs`, `edge-service token add`)"
            )
        return self


class DownsampleConfig(Table):
    """`[downsample]`: length of an interval."""

    interval_s: float = Field(0.1, ge=0.001, le=10.0)


class EstimatorConfig(Table):
    """`[estimator]`: `auto` is `fused` where the machine file is commissioned, else `kf-imm`."""

    method: str = AUTO
    engine: Literal["compiled", "filterpy"] = "compiled"
    activation_exponent: float = Field(1.33, ge=1.0, le=8.0)
    window_s: float = Field(1.0, ge=0.0, le=3600.0)

    @field_validator("method", mode="before")
    @classmethod
    def _known_method(cls, value: object) -> object:
        *names, last = (repr(name) for name in (AUTO, *ESTIMATORS))
        if value != AUTO and value not in ESTIMATORS:
            expected = f"Input should be {', '.join(names)} or {last}"
            raise PydanticCustomError("literal_error", "{expected}", {"expected": expected})
        return value

    @model_validator(mode="after")
    def _engine_fits(self) -> "EstimatorConfig":
        if self.engine == "filterpy" and self.method != "kf-imm":
            raise ValueError("engine 'filterpy' has Kalman filters only; set method = 'kf-imm'")
        return self


class HealthConfig(Table):
    """`[health]`: limits of the axis condition, in percent of the fresh screw's preload."""

    warning_percent_of_fresh: float = Field(60.0, gt=0.0, le=100.0)
    fault_percent_of_fresh: float = Field(30.0, gt=0.0, le=100.0)

    @model_validator(mode="after")
    def _ordered(self) -> "HealthConfig":
        if self.fault_percent_of_fresh >= self.warning_percent_of_fresh:
            raise ValueError("fault_percent_of_fresh must lie below warning_percent_of_fresh")
        return self


class AxisConfig(Table):
    """`[[axes]]`: one axis, its machine file and its driver."""

    name: str
    machine: Path = DEFAULT_MACHINE
    driver: str = "simulated"
    settings: dict[str, Any] = {}

    @field_validator("name")
    @classmethod
    def _key_part(cls, value: str) -> str:
        return check_part(value)


class EdgeConfig(Table):
    """The whole configuration file."""

    service: ServiceConfig = ServiceConfig()
    bus: BusConfig = BusConfig()
    http: HttpConfig = HttpConfig()
    downsample: DownsampleConfig = DownsampleConfig()
    estimator: EstimatorConfig = EstimatorConfig()
    health: HealthConfig = HealthConfig()
    mqtt: MqttConfig | None = None
    opcua: OpcuaConfig | None = None
    mtconnect: MtconnectConfig | None = None
    vibration: VibrationConfig | None = None
    alarms: AlarmsConfig = AlarmsConfig()
    webhook: WebhookConfig = WebhookConfig()
    email: EmailConfig = EmailConfig()
    history: HistoryConfig = HistoryConfig()
    jobs: JobsConfig = JobsConfig()
    axes: tuple[AxisConfig, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _unique_axes(self) -> "EdgeConfig":
        names = [axis.name for axis in self.axes]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"axes: two axes are named {name!r}")
        return self

    @model_validator(mode="after")
    def _guarded(self) -> "EdgeConfig":
        opcua = self.opcua
        if opcua and not is_loopback(opcua.host) and self.http.tokens_file is None:
            raise ValueError("opcua.host: beyond loopback it needs the [http] tokens_file")
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
    content = _read_toml(path)
    for key in open_secrets(EdgeConfig, content, path):
        log.warning("%s: others may read it, and it holds %s; use %s_file", path, key, key)
    try:
        content = with_table_secrets(EdgeConfig, content, path.parent)
    except SecretError as error:
        raise ConfigError(f"{path}: {error}") from None
    config = _checked(EdgeConfig, content, path)
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
        "history": _placed(config.history, folder, "folder"),
        **{name: _with_buffer(config, name, folder) for name in OF_HTTP},
        "mqtt": _placed(config.mqtt, folder, *MQTT_FILES),
        "bus": _placed(config.bus, folder, "certificates"),
        "http": _with_key(config.http, folder, "certificate", "tokens_file"),
        "opcua": config.opcua and _with_key(config.opcua, folder, "certificate"),
        "vibration": _placed(config.vibration, folder, "keep_folder"),
    }
    return config.model_copy(update=placed)


def _with_key(table: HttpConfig | OpcuaConfig, folder: Path, *keys: str) -> Table | None:
    """Paths of the files that let people in; the key may be among systemd's credentials."""
    key = table.private_key and secret_path(folder, table.private_key)
    return _placed(table.model_copy(update={"private_key": key}), folder, *keys)


def _with_buffer(config: EdgeConfig, output: str, folder: Path) -> EventOutputConfig:
    """Events wait in the folder of the history, unless something else is said."""
    table: EventOutputConfig = getattr(config, output)
    usual = (config.history.folder or folder) / f"{output}-buffer.sqlite"
    placed = table.model_copy(update={"buffer": folder / (table.buffer or usual)})
    if isinstance(placed, EmailConfig) and placed.ca_certificate is not None:
        return placed.model_copy(update={"ca_certificate": folder / placed.ca_certificate})
    return placed


def load_machine(path: Path, axis_number: int | None = None) -> Machine:
    """Read and check a machine file. Raises ConfigError like `load_config`.

    Args:
        axis_number: the controller's number of the axis, in place of the file's.
    """
    machine = _checked(Machine, _read_toml(path), path)
    if axis_number is not None:
        axis = machine.axis.model_copy(update={"number": axis_number})
        machine = machine.model_copy(update={"axis": axis})
    if machine.effects:
        from .models.effects.registry import machine_effects

        try:
            machine_effects(machine)
        except ValueError as error:
            raise ConfigError(f"{path}: effects: {error}") from None
    return machine


def load_fleet(path: Path) -> FleetConfig:
    """Read and check a fleet file. Raises ConfigError like `load_config`."""
    fleet = _checked(FleetConfig, _read_toml(path), path)
    files = ("token_file", "ca_certificate")
    services = tuple(_placed(each, path.parent, *files) for each in fleet.services)
    return fleet.model_copy(update={"services": services})


def check_settings(model: type[_Model], settings: dict[str, Any], where: str) -> _Model:
    """Check a driver's settings; ConfigError names the key below `where`."""
    try:
        return model.model_validate(with_secrets(model, settings, Path()))
    except SecretError as error:
        raise ConfigError(f"{where}.{error}") from None
    except ValidationError as error:
        raise ConfigError(f"{where}.{explain(error, model)}") from None


def _placed(table: Table | None, folder: Path, *keys: str) -> Table | None:
    """The paths in a table are relative to the configuration file."""
    if table is None:
        return None
    paths = {key: getattr(table, key) for key in keys}
    return table.model_copy(update={key: folder / path for key, path in paths.items() if path})


def _anchored(settings: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Files that a driver is told of are relative to the configuration file, too."""
    named = [key for key in settings if key in FILE_KEYS or key.endswith("_file")]
    files = {key: settings[key] for key in named if isinstance(settings[key], str)}
    return settings | {key: str(secret_path(folder, Path(name))) for key, name in files.items()}


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        content = path.read_bytes()
        if _DEEP.search(content):
            raise ConfigError(f"{path}: is not valid TOML: nested too deeply")
        return tomllib.loads(content.decode())
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from None
    except RecursionError:
        raise ConfigError(f"{path}: is not valid TOML: nested too deeply") from None


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
        if first["type"] != "value_error" and _may_be_shown(first, model):
            problem += f" (got {first['input']!r})"
    more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    return f"{location}: {problem}{more}" if location else f"{problem}{more}"


def _may_be_shown(mistake: ErrorDetails, model: type[BaseModel]) -> bool:
    """Tell whether what was given is a plain value, and of no key that holds a secret."""
    secret = {key for table in _tables(model) for key in secret_keys(table)}
    return not secret & set(mistake["loc"]) and not isinstance(mistake["input"], dict | list)


def _key_path(location: tuple[int | str, ...]) -> str:
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}"
    return path.removeprefix(".")


def _closest(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """A hint at the table in which a key belongs, or at the known key that was perhaps meant."""
    key, fields = str(location[-1]), model.model_fields.items()
    homes = [name for name, field in fields for each in _within(field) if key in each.model_fields]
    if homes:
        return f" here; it belongs under {' or '.join(f'[{name}]' for name in homes)}"
    known = {name for table in _tables(model) for name in table.model_fields}
    near = difflib.get_close_matches(key, sorted(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def _tables(model: type[BaseModel]) -> list[type[BaseModel]]:
    within = [table for field in model.model_fields.values() for table in _within(field)]
    return [model, *(deeper for table in within for deeper in _tables(table))]


def _within(field: FieldInfo) -> list[type[BaseModel]]:
    """Tables that a field holds, one or several of a kind."""
    candidates = (field.annotation, *getattr(field.annotation, "__args__", ()))
    return [each for each in candidates if isinstance(each, type) and issubclass(each, BaseModel)]
