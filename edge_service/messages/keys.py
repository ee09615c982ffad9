"""Key expressions of the service: `feeddrive/v1/{site}/{machine}/{axis}/{topic}`."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Protocol

from pydantic import AfterValidator

_PART = re.compile(r"[A-Za-z0-9_.\-]{1,100}")
_COLUMN = re.compile(r"[^\x00-\x1f\x7f/\\]{1,100}")
_KIND = re.compile(r"[a-z][a-z0-9_]{0,63}")
_RECORDING = re.compile(r"disagreement_([A-Za-z0-9_.\-]{1,100})_\d{8}T\d{6}Z\.parquet")


def check_part(part: str) -> str:
    """Return `part` if it can stand between two slashes of a key; raise ValueError if not."""
    if not _PART.fullmatch(part):
        raise ValueError(f"{_shown(part)} is no key part: use letters, digits, '_', '-' and '.'")
    return part


def check_column(name: str) -> str:
    """Return `name` if it can be that of a channel or sensor; raise ValueError if not."""
    if not _COLUMN.fullmatch(name):
        raise ValueError(f"{_shown(name)} is no name of a channel")
    return name


def check_kind(kind: str) -> str:
    """Return `kind` if it can name a kind of event; raise ValueError if not."""
    if not _KIND.fullmatch(kind):
        raise ValueError(f"{_shown(kind)} is no kind of event: use a-z, 0-9 and '_'")
    return kind


def check_recording(name: str, axis: str | None = None) -> str:
    """Return `name` if it can be that of a recording by the service; raise ValueError if not.

    Args:
        axis: whose recording it must be; None for any.
    """
    found = _RECORDING.fullmatch(name)
    if found is None or axis not in (None, found[1]):
        raise ValueError(f"{_shown(name)} is no name of a recording by the service")
    return name


def _shown(name: str) -> str:
    return repr(name if len(name) <= 40 else name[:40] + "...")


Column = Annotated[str, AfterValidator(check_column)]
Kind = Annotated[str, AfterValidator(check_kind)]


NODES = frozenset({"acquire", "downsample", "estimate", "health", "http"})
COMPONENTS = NODES | {"service", "history"}
COMPONENTS |= {f"{node}_process" for node in (*NODES, "bus")}
"""Every part of the service that reports on itself, beside outputs and their processes.

`service` is the process in which all nodes run, `..._process` that of one node alone; `history` is
a part of `http`.
"""


_NAME = re.compile(r"[a-z][a-z0-9_-]{0,40}")


def check_component(name: str) -> str:
    """Return `name` if a part of the service, such as an output, may have it; else ValueError."""
    if not _NAME.fullmatch(name):
        raise ValueError(f"{name!r:.60}: expected a small letter, then small letters, digits, _, -")
    return name


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
        """Key of one topic of one axis."""
        return f"{self.root}/{axis}/{topic.name}"

    def all_axes(self, topic: Named) -> str:
        """Key expression of one topic of every axis."""
        return f"{self.root}/*/{topic.name}"

    def component(self, component: str, axis: str | None, topic: Named) -> str:
        """Key of a component's report; `@` keeps it out of the wildcards for axes."""
        parts = [self.root, COMPONENT, component, *([axis] if axis else []), topic.name]
        return "/".join(parts)

    def of_axes(self, axes: Iterable[str], topic: Named) -> frozenset[str]:
        """Keys of one topic of some axes."""
        return frozenset(self.key(axis, topic) for axis in axes)

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
