"""`edge-service check-config`: a configuration checked as a whole, and what it means."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from drivers.registry import driver_names, load_driver

from ..bus.settings import BusConfigurationError, BusSettings, zenoh_config
from ..command_answer import Answer
from ..config import ConfigError, EdgeConfig, load_machine, read_config
from ..nodes.http_rights import check_access
from ..nodes.service import check_service
from ..outputs.base import load_output
from .document import Document

SECRET, HIDDEN = "**********", "***"
"""A secret as pydantic writes it, and as it is shown."""


class ConfiguredAxis(Document):
    """One axis; without what `missing_for_percent` names there is a drag only."""

    name: str
    driver: str
    machine: str
    missing_for_percent: str | None


class CheckedConfiguration(Document):
    """A configuration that is right; sources that do not answer now are `not_reachable`.

    Attributes:
        effective: every key with its value, defaults included; secrets are ***.
    """

    axes: list[ConfiguredAxis]
    not_reachable: list[str]
    http_access: str
    bus_access: str
    outputs: list[str]
    drivers_installed: list[str]
    effective: dict[str, Any]


def check_configuration(path: Path) -> Answer:
    """Check everything that a service checks before it runs. Raises ConfigError, all mistakes."""
    settings, mistakes = read_config(path)
    if settings is None:
        raise ConfigError(*mistakes, file=path)
    access, axes = "", []
    unreachable: list[str] = []
    for axis in settings.axes:
        try:
            missing = load_machine(axis.machine).missing_for_percent()
            alone = settings.model_copy(update={"axes": (axis,), "outputs": {}})
            unreachable += asyncio.run(check_service(alone))
        except ConfigError as error:
            mistakes += error.mistakes
            continue
        machine = str(axis.machine)
        axes.append(
            ConfiguredAxis(
                name=axis.name, driver=axis.driver, machine=machine, missing_for_percent=missing
            )
        )
    for name, table in settings.outputs.items():
        try:
            alone = settings.model_copy(update={"axes": (), "outputs": {name: table}})
            asyncio.run(check_service(alone))
        except ConfigError as error:
            mistakes += error.mistakes
    try:
        bus = settings.bus
        zenoh_config(BusSettings(bus.endpoint, "router", zenoh_file=bus.zenoh_file))
        access = check_access(settings)
    except BusConfigurationError as error:
        mistakes.append(str(error))
    except ConfigError as error:
        mistakes += [f"{path}: {each}" for each in error.mistakes]
    if mistakes:
        raise ConfigError(*mistakes, file=path)
    checked = CheckedConfiguration(
        axes=axes,
        not_reachable=unreachable,
        http_access=access,
        bus_access="bus for others to read (of node bus: to publish too)",
        outputs=[_output(name, table) for name, table in settings.outputs.items()],
        drivers_installed=list(driver_names()),
        effective=effective(settings),
    )
    return Answer("\n".join(_lines(settings, checked)), checked)


def effective(settings: EdgeConfig) -> dict[str, Any]:
    """Every key of a configuration that is right, with its value; secrets are ***."""
    shown = settings.model_dump(mode="json")
    for axis in shown["axes"]:
        axis["settings"] = _dumped(load_driver(axis["driver"]).config_model, axis["settings"])
    for name, table in shown["outputs"].items():
        model = load_output(table.get("kind") or name).config_model
        shown["outputs"][name] = _dumped(model, table)
    return _hidden(shown)  # type: ignore[no-any-return]


def _dumped(model: type[BaseModel], table: dict[str, Any]) -> dict[str, Any]:
    """A table with its defaults; a secret that is in a file of its own stays there."""
    return model.model_validate(table).model_dump(mode="json")


def _hidden(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _hidden(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_hidden(each) for each in value]
    return HIDDEN if value == SECRET else value


def _output(name: str, table: dict[str, Any]) -> str:
    """An output in words: its kind, and where it is if a table says so."""
    kind, place = table.get("kind", name), table.get("endpoint") or table.get("url")
    return " ".join([name, *([f"({kind})"] if kind != name else []), *([place] if place else [])])


def _lines(settings: EdgeConfig, checked: CheckedConfiguration) -> Iterator[str]:
    for each in checked.axes:
        missing = each.missing_for_percent
        said = f"drag only ({missing} is unknown)" if missing else "preload in %"
        yield f"axis {each.name}: driver {each.driver}, machine {each.machine}, {said}"
    for line in checked.not_reachable:
        yield f"not reachable now: {line}"
    http, store = settings.http, settings.store
    yield f"bus {settings.bus.endpoint}, http {http.host}:{http.port}"
    yield f"access: {checked.http_access}; {checked.bus_access}"
    for output in checked.outputs:
        yield f"output {output}"
    if store.folder is None:
        yield "history in memory, it ends with the service ([store] folder)"
    else:
        yield f"history in {store.folder}, up to {store.budget_mb:g} MB"
    yield f"drivers installed: {', '.join(checked.drivers_installed)}"
