"""Key expressions of the service: `feeddrive/v1/{site}/{machine}/{axis}/{topic}`."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .components import COMPONENTS

if TYPE_CHECKING:  # its codecs load numpy, which whoever only needs a key can do without
    from .topics import Topic

ROOT = "feeddrive/v1"
ALIVE = "@alive"
COMPONENT = "@component"


_ROOT_PARTS = 4


def axis_of(key: str) -> str:
    """Axis that a key names; empty if it serves all axes.

    >>> axis_of("feeddrive/v1/site/machine/X/raw")
    'X'
    >>> axis_of("feeddrive/v1/site/machine/@component/http/status")
    ''
    """
    match key.split("/")[_ROOT_PARTS:]:
        case [axis, _topic] | [_, _, axis, _topic] if not axis.startswith("@"):
            return axis
        case _:
            return ""


@dataclass(frozen=True, slots=True)
class MachineKeys:
    """The keys of one machine at one site, and the names of its outputs."""

    site: str
    machine: str
    outputs: tuple[str, ...] = ()

    @property
    def root(self) -> str:
        """Common prefix of all keys of the machine."""
        return f"{ROOT}/{self.site}/{self.machine}"

    @property
    def alive(self) -> str:
        """Key of the liveliness token."""
        return f"{self.root}/{ALIVE}"

    def key(self, axis: str, topic: "Topic[Any]") -> str:
        """Key of one topic of one axis."""
        return f"{self.root}/{axis}/{topic.name}"

    def all_axes(self, topic: "Topic[Any]") -> str:
        """Key expression of one topic of every axis."""
        return f"{self.root}/*/{topic.name}"

    def component(self, component: str, axis: str | None, topic: "Topic[Any]") -> str:
        """Key of a component's report; `@` keeps it out of the wildcards for axes."""
        parts = [self.root, COMPONENT, component, *([axis] if axis else []), topic.name]
        return "/".join(parts)

    def of_axes(self, axes: Iterable[str], topic: "Topic[Any]") -> frozenset[str]:
        """Keys of one topic of some axes."""
        return frozenset(self.key(axis, topic) for axis in axes)

    def of_components(self, axes: Iterable[str], topic: "Topic[Any]") -> frozenset[str]:
        """Keys of the reports that components make, on themselves or on some axes."""
        own = (f"{output}{kind}" for output in self.outputs for kind in ("", "_process"))
        return frozenset(
            self.component(component, axis, topic)
            for component in (*COMPONENTS, *own)
            for axis in (None, *axes)
        )

    def all_components(self, topic: "Topic[Any]") -> str:
        """Key expression of the reports of every component."""
        return f"{self.root}/{COMPONENT}/**/{topic.name}"
