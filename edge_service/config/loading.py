"""Configuration, machine and fleet files: read, checked, and their paths placed."""

import hashlib
import json
import logging
import os
import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from ..config_tables import (
    StoreConfig,
    Table,
)
from ..models.machine import Machine
from ..secret_files import SecretError, open_secrets, secret_path, with_secrets
from .gone import GONE_SETTINGS, gone_key
from .mistakes import ConfigError, explain
from .service import AxisConfig, EdgeConfig, HttpConfig

log = logging.getLogger(__name__)
DEFAULT_CONFIG = Path(__file__).parents[1] / "defaults" / "edge.toml"
BROKER_FILES = ("ca_certificate", "client_certificate", "client_key")
_OF_SECURITY = ("certificate", "private_key", "server_certificate")
FILE_KEYS = ("path", "folder", *_OF_SECURITY, *BROKER_FILES)
"""Keys of drivers that name files or folders."""
_Model = TypeVar("_Model", bound=BaseModel)
_DEEP = re.compile(rb"(?:[\[{]\s*){100}")


def load_config(path: Path) -> EdgeConfig:
    """Read and check a configuration file; paths in it are relative to its folder.

    Raises:
        ConfigError: one line with the file, the key, what was wrong and what was expected.
    """
    written = _read(path)
    content = _parsed(path, written)
    gone = gone_key(content)
    if gone is not None:
        raise ConfigError(f"{path}: {gone}")
    for key in open_secrets(content, path):
        log.warning("%s: other users can read it, and it contains %s; use %s_file", path, key, key)
    config = _checked(EdgeConfig, content, path)
    axes = tuple(
        axis.model_copy(
            update={
                "machine": path.parent / axis.machine,
                "settings": _anchored(axis.settings, path.parent),
            }
        ).of_file(path)
        for axis in config.axes
    )
    folder = path.parent
    placed = {
        "axes": axes,
        "store": _stored(config.store, folder),
        "bus": _placed(config.bus, folder, "zenoh_file"),
        "http": _with_key(config.http, folder, "certificate"),
        "outputs": {name: _anchored(table, folder) for name, table in config.outputs.items()},
    }
    return config.model_copy(update=placed).of_digest(_digest(written, axes)).of_file(path)


def _digest(config: bytes, axes: tuple[AxisConfig, ...]) -> str:
    """Short digest of a configuration and the machine files of its axes."""
    machines = {}
    for axis in axes:
        try:
            machines[axis.name] = hashlib.sha256(axis.machine.read_bytes()).hexdigest()
        except OSError:  # missing: told by whoever needs it
            machines[axis.name] = ""
    described = json.dumps([hashlib.sha256(config).hexdigest(), machines], sort_keys=True)
    return hashlib.sha256(described.encode()).hexdigest()[:12]


def _with_key(table: HttpConfig, folder: Path, *keys: str) -> Table | None:
    """Paths of the files that let people in; the key may be among systemd's credentials."""
    key = table.private_key and secret_path(folder, table.private_key)
    return _placed(table.model_copy(update={"private_key": key}), folder, *keys)


def state_folder(named: Path | None, folder: Path) -> Path | None:
    """Folder of the store, by default the one that systemd gives the service; None: none.

    Args:
        named: as the configuration names it.
        folder: of the configuration.
    """
    given = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    if named is not None:
        return folder / named
    return Path(given) if given else None


def _stored(table: StoreConfig, folder: Path) -> Table:
    return table.model_copy(update={"folder": state_folder(table.folder, folder)})


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
        from ..models.effects.registry import machine_effects

        try:
            machine_effects(machine)
        except ValueError as error:
            raise ConfigError(f"{path}: effects: {error}") from None
    return machine


def check_settings(model: type[_Model], settings: dict[str, Any], where: str) -> _Model:
    """Check a driver's settings; ConfigError names the key below `where`."""
    try:
        return model.model_validate(with_secrets(model, settings, Path()))
    except SecretError as error:
        raise ConfigError(f"{where}.{error}") from None
    except ValidationError as error:
        for each in error.errors():
            key = ".".join(part for part in each["loc"] if isinstance(part, str))
            if each["type"] == "extra_forbidden" and key in GONE_SETTINGS:
                raise ConfigError(f"{where}.{key}: {GONE_SETTINGS[key]}") from None
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
    return _parsed(path, _read(path))


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None


def _parsed(path: Path, content: bytes) -> dict[str, Any]:
    try:
        if _DEEP.search(content):
            raise ConfigError(f"{path}: is not valid TOML: nested too deeply")
        return tomllib.loads(content.decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: is not valid TOML: {error}") from None
    except RecursionError:
        raise ConfigError(f"{path}: is not valid TOML: nested too deeply") from None


def _checked(model: type[_Model], content: dict[str, Any], path: Path) -> _Model:
    try:
        return model.model_validate(content)
    except ValidationError as error:
        raise ConfigError(f"{path}: {explain(error, model)}") from None
