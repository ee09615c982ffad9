"""Configuration, machine and fleet files: read, checked, and their paths placed."""

import hashlib
import json
import os
import tomllib
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from .. import DEFAULTS
from ..models.machine import Machine
from ..secret_files import SecretError, open_secrets, secret_path, with_secrets
from .mistakes import ConfigError, explain, gone_keys
from .service import AxisConfig, AxisFile, EdgeConfig

DEFAULT_CONFIG = DEFAULTS / "edge.toml"
BROKER_FILES = ("ca_certificate", "client_certificate", "client_key")
_OF_SECURITY = ("certificate", "private_key", "server_certificate")
FILE_KEYS = ("path", "folder", "truth", *_OF_SECURITY, *BROKER_FILES)
"""Keys of drivers that name files or folders."""
_Model = TypeVar("_Model", bound=BaseModel)


def load_config(path: Path) -> EdgeConfig:
    """Read and check a configuration file; paths in it are relative to its folder.

    Raises ConfigError: file, key, what was wrong and what was expected.
    """
    config, mistakes = read_config(path)
    if config is None or mistakes:
        raise ConfigError(*mistakes, file=path)
    return config


def read_config(path: Path) -> tuple[EdgeConfig | None, list[str]]:
    """The configuration in a file, without the keys that are wrong, and these mistakes.

    It is None where nothing is left of it. Raises ConfigError: the file cannot be read at all.
    """
    written = _read(path)
    content = _parsed(path, written)
    if "axes" not in content and {"axis", "model"} & content.keys():
        kind = "this is a machine file ([axis], [model])"
        raise ConfigError(f"{path}: {kind}; expected a configuration, which has [[axes]]")
    gone, axes = gone_keys(content), content.get("axes")
    mistakes, config = [*gone, *open_secrets(content, path)], None
    try:
        config = EdgeConfig.model_validate(content)
    except ValidationError as error:
        known = tuple(f"{each.partition(': ')[0]}" for each in gone)
        for said in explain(error, EdgeConfig, content):
            key = said.partition(": ")[0]
            if not any(key == each or each.startswith(f"{key}.") for each in known):
                mistakes.append(said)
        config = _without(content, error)
    if config is None:
        return None, [f"{path}: {each}" for each in mistakes]
    config = _placed_config(config, path)
    state = config.store.folder
    if state is not None and state.exists() and not state.is_dir():
        mistakes.append(f"store.folder: {state}: expected a folder")
    if not axes and state is None:
        mistakes.append("axes: missing; expected [[axes]], or [store] folder for axes of the page")
    told = [f"{path}: {each}" for each in mistakes]
    for file in axis_files(state):
        try:
            axis = read_axis(file)
            if any(each.name == axis.name for each in config.axes):
                raise ConfigError(f"{axis.place}: stands in {path} as well; remove one of the two")
            config = config.with_axis(axis)
        except ConfigError as error:
            told += error.mistakes
        except ValueError as error:
            told.append(f"{file}: {error}")
    return config.of_digest(_digest(written, config.axes)).of_file(path), told


def axis_files(state: Path | None) -> list[Path]:
    """Files of the axes that were made on the page, in the state folder."""
    return [] if state is None else sorted(state.absolute().glob("axes/[!.]*/axis.toml"))


def read_axis(path: Path, written: bytes | None = None) -> AxisConfig:
    """The axis in a file of the state folder, paths relative to it. Raises ConfigError."""
    content = _parsed(path, _read(path) if written is None else written)
    try:
        (axis,) = AxisFile.model_validate(content).axes
    except ValidationError as error:
        told = explain(error, AxisFile, content)
        raise ConfigError(*(f"{path}: {each}" for each in told)) from None
    if axis.name != path.parent.name:
        raise ConfigError(f"{path}: axes.{axis.name}: expected the name {path.parent.name!r}")
    return _placed_axis(axis, path)


def _without(content: dict[str, Any], error: ValidationError) -> EdgeConfig | None:
    """Configuration without the keys that are wrong, if that is one."""
    for mistake in error.errors():
        *above, last = mistake["loc"] or ("",)
        table: Any = content
        with suppress(LookupError, TypeError):  # missing, or gone with another
            for part in above:
                table = table[part]
            del table[last]
    try:
        return EdgeConfig.model_validate(content)
    except ValidationError:
        return None


def _placed_axis(axis: AxisConfig, path: Path) -> AxisConfig:
    settings = _anchored(axis.settings, path.parent)
    placed = {"machine": path.parent / axis.machine, "settings": settings}
    return axis.model_copy(update=placed).of_file(path)


def _placed_config(config: EdgeConfig, path: Path) -> EdgeConfig:
    folder, store, http = path.parent, config.store, config.http
    key = http.private_key and secret_path(folder, http.private_key)
    placed = {
        "axes": tuple(_placed_axis(axis, path) for axis in config.axes),
        "store": store.model_copy(update={"folder": state_folder(store.folder, folder)}),
        "bus": _placed(config.bus, folder, "zenoh_file"),
        "http": _placed(http.model_copy(update={"private_key": key}), folder, "certificate"),
        "outputs": {name: _anchored(table, folder) for name, table in config.outputs.items()},
    }
    return config.model_copy(update=placed)


def _digest(config: bytes, axes: tuple[AxisConfig, ...]) -> str:
    machines = {}
    for axis in axes:
        try:
            machines[axis.name] = hashlib.sha256(_read(axis.machine)).hexdigest()
        except ConfigError:  # told by whoever needs it
            machines[axis.name] = ""
    described = json.dumps([hashlib.sha256(config).hexdigest(), machines], sort_keys=True)
    return hashlib.sha256(described.encode()).hexdigest()[:12]


def state_folder(named: Path | None, folder: Path) -> Path | None:
    """Folder of the store, by default the one that systemd gives the service; None: none."""
    given = os.environ.get("STATE_DIRECTORY", "").split(":")[0]
    return folder / named if named is not None else Path(given) if given else None


def load_machine(path: Path, axis_number: int | None = None) -> Machine:
    """Read and check a machine file; a number given replaces its own. Errors as `load_config`."""
    content = _parsed(path, _read(path))
    axes = content.get("axes")
    if "axis" not in content and isinstance(axes, list):
        named = [each for each in axes if isinstance(each, dict) and "machine" in each]
        hint = "".join(f"; that of axis {a.get('name')} is {a['machine']}" for a in named[:1])
        raise ConfigError(f"{path}: this is a configuration; expected a machine file{hint}")
    try:
        machine = Machine.model_validate(content)
    except ValidationError as error:
        raise ConfigError(*(f"{path}: {each}" for each in explain(error, Machine))) from None
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
    """Check the settings of a driver or output; ConfigError names their keys below `where`."""
    try:
        return model.model_validate(with_secrets(model, settings, Path()))
    except SecretError as error:
        raise ConfigError(f"{where}.{error}") from None
    except ValidationError as error:
        raise ConfigError(*(f"{where}.{each}" for each in explain(error, model))) from None


def _placed(table: _Model, folder: Path, key: str) -> _Model:
    """The path in a table is relative to the configuration file."""
    path = getattr(table, key)
    return table.model_copy(update={key: folder / path}) if path else table


def _anchored(settings: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Files that a driver is told of are relative to the configuration file, too."""
    named = [key for key in settings if key in FILE_KEYS or key.endswith("_file")]
    files = {key: settings[key] for key in named if isinstance(settings[key], str)}
    return settings | {key: str(secret_path(folder, Path(name))) for key, name in files.items()}


def _read(path: Path) -> bytes:
    if path.exists() and not path.is_file():
        raise ConfigError(f"{path}: a folder or device; expected a file")
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read ({error.strerror})") from None


def _parsed(path: Path, content: bytes) -> dict[str, Any]:
    try:
        return tomllib.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        words = "nested too deeply" if isinstance(error, RecursionError) else error
        raise ConfigError(f"{path}: is not valid TOML: {words}") from None
