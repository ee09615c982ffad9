"""Key expressions of the service: `feeddrive/v1/{site}/{machine}/{axis}/{topic}`."""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Protocol

from pydantic import AfterValidator

_RECORDING = re.compile(r"disagreement_([A-Za-z0-9_.\-]{1,100})_\d{8}T\d{6}Z\.parquet")


def _check(pattern: str, problem: str) -> Callable[[str], str]:
    """Check that returns a name that fits a pattern, and raises ValueError for another."""
    wanted = re.compile(pattern)

    def check(name: str) -> str:
        if not wanted.fullmatch(name):
            raise ValueError(f"{name!r:.60} {problem}")
        return name

    return check


check_part = _check(
    r"(?!\.)[A-Za-z0-9_.\-]{1,100}", "is no key part: use letters, digits, '_', '-' and '.'"
)
"""Of what stands between two slashes of a key."""
check_component = _check(
    r"[a-z][a-z0-9_-]{0,40}", "is no part: use a letter, then a-z, digits, _ and -"
)
"""Of a part of the service, such as an output."""
check_column = _check(r"[^\x00-\x1f\x7f/\\]{1,100}", "is no name of a channel")
"""Of a channel or sensor."""
_check_kind = _check(r"[a-z][a-z0-9_]{0,63}", "is no kind of event: use a-z, 0-9 and '_'")
Column = Annotated[str, AfterValidator(check_column)]
Kind = Annotated[str, AfterValidator(_check_kind)]


def check_recording(name: str, axis: str | None = None) -> str:
    """Return `name` if it can be that of a recording by the service; raise ValueError if not."""
    found = _RECORDING.fullmatch(name)
    if found is None or axis not in (None, found[1]):
        raise ValueError(f"{name!r:.60} is no name of a recording by the service")
    return name


NODES = frozenset({"acquire", "downsample", "estimate", "health", "http"})
COMPONENTS = NODES | {"service", "history"}
COMPONENTS |= {f"{node}_process" for node in (*NODES, "bus")}
"""Every part of the service that reports on itself, beside outputs and their processes.

`service` is the process in which all nodes run, `..._process` that of one node alone; `history` is
a part of `http`.
"""

ROOT = "feeddrive/v1"
ALIVE = "@alive"
COMPONENT = "@component"
_ROOT_PARTS = 4


@lru_cache(1024)
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


class Named(Protocol):
    """A topic, as far as its key goes."""

    @property
    def name(self) -> str: ...


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

    def key(self, axis: str, topic: Named) -> str:
        return f"{self.root}/{axis}/{topic.name}"

    def all_axes(self, topic: Named) -> str:
        """Key expression of one topic of every axis."""
        return f"{self.root}/*/{topic.name}"

    def component(self, component: str, axis: str | None, topic: Named) -> str:
        """Key of a component's report; `@` keeps it out of the wildcards for axes."""
        parts = [self.root, COMPONENT, component, *([axis] if axis else []), topic.name]
        return "/".join(parts)

    def of_components(self, axes: Iterable[str], topic: Named) -> frozenset[str]:
        """Keys of the reports that components make, on themselves or on some axes."""
        own = (f"{output}{kind}" for output in self.outputs for kind in ("", "_process"))
        return frozenset(
            self.component(component, axis, topic)
            for component in (*COMPONENTS, *own)
            for axis in (None, *axes)
        )

    def all_components(self, topic: Named) -> str:
        """Key expression of the reports of every component."""
        return f"{self.root}/{COMPONENT}/**/{topic.name}"
