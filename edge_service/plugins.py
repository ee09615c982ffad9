"""Drivers and outputs by their entry points, and the error of settings that cannot work."""

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any


class UnknownPluginError(Exception):
    """Nothing of that name is installed, or it cannot be loaded."""


class MisconfiguredError(Exception):
    """The configuration is wrong; trying again will not help."""

    def __init__(self, key: str, problem: str) -> None:
        super().__init__(f"{key}: {problem}")
        self.key, self.problem = key, problem


@cache
def plugins(group: str) -> dict[str, EntryPoint]:
    """Entry points of a group, such as `edge_service.drivers`, by their names in order."""
    return {each.name: each for each in sorted(entry_points(group=group))}


def load_plugin(group: str, name: str) -> Any:
    """Load what an entry point names; UnknownPluginError says what there is instead."""
    kind, there = group.removeprefix("edge_service.").removesuffix("s"), plugins(group)
    if name not in there:
        raise UnknownPluginError(f"no {kind} {name!r} is installed; there are {', '.join(there)}")
    try:
        return there[name].load()
    except (ImportError, AttributeError) as error:
        raise UnknownPluginError(f"{kind} {name!r} cannot be loaded: {error}") from error
