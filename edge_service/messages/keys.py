"""Key expressions of the service: `feeddrive/v1/{site}/{machine}/{axis}/{topic}`."""

import re
from dataclasses import dataclass
from typing import Any

from .topics import Topic

ROOT = "feeddrive/v1"
ALIVE = "@alive"
COMPONENT = "@component"
_PART = re.compile(r"[A-Za-z0-9_.\-]+")


def check_part(part: str) -> str:
    """Return `part` if it can stand between two slashes of a key; raise ValueError if not."""
    if not _PART.fullmatch(part):
        raise ValueError(f"{part!r} is no key part: use letters, digits, '_', '-' and '.'")
    return part


@dataclass(frozen=True, slots=True)
class MachineKeys:
    """The keys of one machine at one site."""

    site: str
    machine: str

    @property
    def root(self) -> str:
        """Common prefix of all keys of the machine."""
        return f"{ROOT}/{self.site}/{self.machine}"

    @property
    def alive(self) -> str:
        """Key of the liveliness token."""
        return f"{self.root}/{ALIVE}"

    def key(self, axis: str, topic: Topic[Any]) -> str:
        """Key of one topic of one axis."""
        return f"{self.root}/{axis}/{topic.name}"

    def all_axes(self, topic: Topic[Any]) -> str:
        """Key expression of one topic of every axis."""
        return f"{self.root}/*/{topic.name}"

    def component(self, component: str, axis: str | None, topic: Topic[Any]) -> str:
        """Key of a component's report; `@` keeps it out of the wildcards for axes."""
        parts = [self.root, COMPONENT, component, *([axis] if axis else []), topic.name]
        return "/".join(parts)

    def all_components(self, topic: Topic[Any]) -> str:
        """Key expression of the reports of every component."""
        return f"{self.root}/{COMPONENT}/**/{topic.name}"
