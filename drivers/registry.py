"""Finding drivers by name through the entry-point group."""

from edge_service.plugins import load_plugin, plugins

from .base import ENTRY_POINT_GROUP, Driver


def driver_names() -> list[str]:
    return list(plugins(ENTRY_POINT_GROUP))


def load_driver(name: str) -> type[Driver]:
    """The class of a driver. Raises UnknownPluginError."""
    found: type[Driver] = load_plugin(ENTRY_POINT_GROUP, name)
    return found
