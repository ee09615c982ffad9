"""`edge-service check-config`: a configuration checked as a whole, and what it means."""

import asyncio
from pathlib import Path
from typing import Any

from drivers.base import driver_names, load_driver

from ..bus.settings import BusConfigurationError, BusSettings, zenoh_config
from ..command_answer import Answer
from ..config import ConfigError, EdgeConfig, load_machine, read_config
from ..nodes.http_rights import check_access
from ..nodes.service import check_service
from ..outputs.base import load_output

SECRET, HIDDEN = "**********", "***"
"""A secret as pydantic writes it, and as it is shown."""


def check_configuration(path: Path) -> Answer:
    """Check everything that a service checks before it runs. Raises ConfigError, all mistakes."""
    settings, mistakes = read_config(path)
    if settings is None:
        raise ConfigError(*mistakes, file=path)
    access, axes, lines = "", [], []
    unreachable: list[str] = []
    for axis in settings.axes:
        try:
            missing = load_machine(axis.machine).missing_for_percent()
            alone = settings.model_copy(update={"axes": (axis,), "outputs": {}})
            unreachable += asyncio.run(check_service(alone))
        except ConfigError as error:
            mistakes += error.mistakes
            continue
        said = f"drag only ({missing} is unknown)" if missing else "preload in %"
        lines.append(f"axis {axis.name}: driver {axis.driver}, machine {axis.machine}, {said}")
        named = {"name": axis.name, "driver": axis.driver, "machine": str(axis.machine)}
        axes.append({**named, "missing_for_percent": missing})
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
    bus_access = "programs of this machine may read the bus (of `node bus` also publish)"
    outputs = []
    for name, table in settings.outputs.items():
        kind, at = table.get("kind", name), table.get("endpoint") or table.get("url")
        said = name if kind == name else f"{name} ({kind})"
        outputs.append(f"{said} {at}" if at else said)
    http, store, drivers = settings.http, settings.store, list(driver_names())
    history = "history in memory, it ends with the service ([store] folder)"
    if store.folder is not None:
        history = f"history in {store.folder}, up to {store.budget_mb:g} MB"
    lines += [
        *(f"not reachable now: {line}" for line in unreachable),
        f"bus {bus.endpoint}, http {http.host}:{http.port}",
        f"access: {access}; {bus_access}",
        *(f"output {output}" for output in outputs),
        history,
        f"drivers installed: {', '.join(drivers)}",
    ]
    document = {"axes": axes, "not_reachable": unreachable, "http_access": access}
    document |= {"bus_access": bus_access, "outputs": outputs, "drivers_installed": drivers}
    document["effective"] = effective(settings)
    return Answer("\n".join(lines), document)


def effective(settings: EdgeConfig) -> dict[str, Any]:
    """Every key of a configuration that is right, with its value; secrets are ***."""
    shown = settings.model_dump(mode="json")
    for axis in shown["axes"]:
        own = load_driver(axis["driver"]).config_model
        axis["settings"] = own.model_validate(axis["settings"]).model_dump(mode="json")
    for name, table in shown["outputs"].items():
        model = load_output(table.get("kind") or name).config_model
        shown["outputs"][name] = model.model_validate(table).model_dump(mode="json")
    return _hidden(shown)  # type: ignore[no-any-return]


def _hidden(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _hidden(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_hidden(each) for each in value]
    return HIDDEN if value == SECRET else value
