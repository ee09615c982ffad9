"""`edge-service check-config`: a configuration checked as a whole, and what it means."""

import asyncio
from collections.abc import Iterator
from pathlib import Path

from drivers.registry import driver_names

from ..command_answer import Answer
from ..config import EdgeConfig, load_config
from ..nodes.outputs.mail.output import check_email
from ..nodes.outputs.opcua_rights import opcua_settings
from ..nodes.service import check_service
from ..nodes.wiring.bus_certificates import check_bus
from ..nodes.wiring.http_rights import check_access
from ..nodes.wiring.stages import load_machines
from .document import Document


class ConfiguredAxis(Document):
    """One axis; without what `missing_for_percent` names there is a drag only."""

    name: str
    driver: str
    machine: str
    missing_for_percent: str | None


class ServedOpcua(Document):
    """The OPC UA server that others read from."""

    host: str
    port: int
    encrypted: bool
    needs_token: bool


class ServedMtconnect(Document):
    """The adapter of MTConnect, which asks nobody who they are."""

    host: str
    port: int


class CheckedConfiguration(Document):
    """A configuration that is right; sources that do not answer now are `not_reachable`."""

    axes: list[ConfiguredAxis]
    not_reachable: list[str]
    http_host: str
    http_port: int
    http_access: str
    bus_endpoint: str
    bus_access: str
    opcua: ServedOpcua | None
    mtconnect: ServedMtconnect | None
    history_folder: str | None
    history_budget_mb: float
    drivers_installed: list[str]


def check_configuration(path: Path) -> Answer:
    """Check everything that a service checks before it runs. Raises ConfigError."""
    settings = load_config(path)
    check_email(settings.email)
    unreachable = asyncio.run(check_service(settings))
    checked = CheckedConfiguration(
        axes=_axes(settings),
        not_reachable=list(unreachable),
        http_host=settings.http.host,
        http_port=settings.http.port,
        http_access=check_access(settings.http),
        bus_endpoint=settings.bus.endpoint,
        bus_access=check_bus(settings.bus),
        opcua=_opcua(settings),
        mtconnect=_mtconnect(settings),
        history_folder=None if settings.history.folder is None else str(settings.history.folder),
        history_budget_mb=settings.history.budget_mb,
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


def _opcua(settings: EdgeConfig) -> ServedOpcua | None:
    if settings.opcua is None:
        return None
    served = opcua_settings(settings)
    return ServedOpcua(
        host=served.host,
        port=served.port,
        encrypted=served.certificate is not None,
        needs_token=served.knows is not None,
    )


def _mtconnect(settings: EdgeConfig) -> ServedMtconnect | None:
    served = settings.mtconnect
    return None if served is None else ServedMtconnect(host=served.host, port=served.port)


def _lines(checked: CheckedConfiguration) -> Iterator[str]:
    for each in checked.axes:
        missing = each.missing_for_percent
        said = f"drag only ({missing} is unknown)" if missing else "preload in %"
        yield f"axis {each.name}: driver {each.driver}, machine {each.machine}, {said}"
    for line in checked.not_reachable:
        yield f"not reachable now: {line}"
    yield f"bus {checked.bus_endpoint}, http {checked.http_host}:{checked.http_port}"
    yield f"access: {checked.http_access}; {checked.bus_access}"
    if checked.opcua is not None:
        channel = "encrypted" if checked.opcua.encrypted else "open"
        users = "whoever has a token" if checked.opcua.needs_token else "anybody"
        yield f"opcua {checked.opcua.host}:{checked.opcua.port}, {channel}, for {users}"
    if checked.mtconnect is not None:
        yield f"mtconnect {checked.mtconnect.host}:{checked.mtconnect.port}, open, for anybody"
    yield _history(checked)
    yield f"drivers installed: {', '.join(checked.drivers_installed)}"


def _history(checked: CheckedConfiguration) -> str:
    if checked.history_folder is None:
        return "history in memory, it ends with the service ([history] folder)"
    return f"history in {checked.history_folder}, up to {checked.history_budget_mb:g} MB"
