"""Finding drivers by name through the entry-point group."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import cast

from .base import ENTRY_POINT_GROUP, Driver

OPTIONAL = ("mqtt", "opcua")
"""Drivers whose library comes with an extra of the same name."""


class UnknownDriverError(Exception):
    """No driver of that name is installed, or it cannot be loaded."""


def driver_names() -> list[str]:
    """Names of the installed drivers."""
    return sorted(_entries())


def load_driver(name: str) -> type[Driver]:
    """The class of a driver; UnknownDriverError says what there is instead."""
    entries = _entries()
    if name not in entries:
        there = ", ".join(driver_names())
        raise UnknownDriverError(f"no driver {name!r} is installed; there are {there}")
    try:
        return cast(type[Driver], entries[name].load())
    except (ImportError, AttributeError) as error:
        is_missing = isinstance(error, ModuleNotFoundError) and name in OPTIONAL
        extra = f"; does `pip install edge-service[{name}]` help?" if is_missing else ""
        raise UnknownDriverError(f"driver {name!r} cannot be loaded: {error}{extra}") from error


@cache
def _entries() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=ENTRY_POINT_GROUP)}
