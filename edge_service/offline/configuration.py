"""`edge-service check-config`: a configuration checked as a whole, and what it means."""

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drivers.registry import driver_names

from ..bus.settings import BusSettings, zenoh_config
from ..command_answer import Answer
from ..config import ConfigError, EdgeConfig, load_config
from ..nodes.service import check_service
from ..nodes.wiring.http_rights import check_access
from ..nodes.wiring.stages import load_machines
from .document import Document


class ConfiguredAxis(Document):
    """One axis; without what `missing_for_percent` names there is a drag only."""

    name: str
    driver: str
    machine: str
    missing_for_percent: str | None


class CheckedConfiguration(Document):
    """A configuration that is right; sources that do not answer now are `not_reachable`."""

    axes: list[ConfiguredAxis]
    not_reachable: list[str]
    http_host: str
    http_port: int
    http_access: str
    bus_endpoint: str
    bus_access: str
    outputs: list[str]
    history_folder: str | None
    history_budget_mb: float
    drivers_installed: list[str]


def check_configuration(path: Path) -> Answer:
    """Check everything that a service checks before it runs. Raises ConfigError."""
    settings = load_config(path)
    unreachable = asyncio.run(check_service(settings))
    zenoh_config(BusSettings(settings.bus.endpoint, "router", zenoh_file=settings.bus.zenoh_file))
    try:
        access = check_access(settings)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None
    checked = CheckedConfiguration(
        axes=_axes(settings),
        not_reachable=list(unreachable),
        http_host=settings.http.host,
        http_port=settings.http.port,
        http_access=access,
        bus_endpoint=settings.bus.endpoint,
        bus_access="bus for others to read (of node bus: to publish too)",
        outputs=[_output(name, table) for name, table in settings.outputs.items()],
        history_folder=None if settings.store.folder is None else str(settings.store.folder),
        history_budget_mb=settings.store.budget_mb,
        drivers_installed=list(driver_names()),
    )
    return Answer("\n".join(_lines(checked)), checked)


def _axes(settings: EdgeConfig) -> list[ConfiguredAxis]:
    machines = load_machines(settings)
    return [
        ConfiguredAxis(
            name=each.name,
            driver=each.driver,
            machine=str(each.machine),
            missing_for_percent=machines[each.name].missing_for_percent(),
        )
        for each in settings.axes
    ]


def _output(name: str, table: dict[str, Any]) -> str:
    """An output in words: its kind, and where it is if a table says so."""
    kind, place = table.get("kind", name), table.get("endpoint")
    return " ".join([name, *([f"({kind})"] if kind != name else []), *([place] if place else [])])


def _lines(checked: CheckedConfiguration) -> Iterator[str]:
    for each in checked.axes:
        missing = each.missing_for_percent
        said = f"drag only ({missing} is unknown)" if missing else "preload in %"
        yield f"axis {each.name}: driver {each.driver}, machine {each.machine}, {said}"
    for line in checked.not_reachable:
        yield f"not reachable now: {line}"
    yield f"bus {checked.bus_endpoint}, http {checked.http_host}:{checked.http_port}"
    yield f"access: {checked.http_access}; {checked.bus_access}"
    for output in checked.outputs:
        yield f"output {output}"
    yield _history(checked)
    yield f"drivers installed: {', '.join(checked.drivers_installed)}"


def _history(checked: CheckedConfiguration) -> str:
    if checked.history_folder is None:
        return "history in memory, it ends with the service ([store] folder)"
    return f"history in {checked.history_folder}, up to {checked.history_budget_mb:g} MB"
