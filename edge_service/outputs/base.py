"""The one protocol between the service and whoever it tells, and the registry of outputs.

An output mirrors a driver: a class in a file of its own, found by its name in the entry-point group
`edge_service.outputs`. It is handed messages and knows nothing else: not the bus, no other output.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import urlsplit

from ..config_tables import Table
from ..messages.addresses import is_loopback
from ..messages.answer import AxisAnswer
from ..messages.event import Event
from ..plugins import load_plugin

ENTRY_POINT_GROUP = "edge_service.outputs"


class OutputUnavailableError(Exception):
    """The other side cannot be reached now; trying again later may help. One line, no secret."""


class RefusedError(Exception):
    """The other side does not take this message, and never will; others it may. No secret."""


class OutputConfig(Table):
    """Base of the tables `[outputs.NAME]`: unknown keys are refused."""

    kind: str = ""


@dataclass(frozen=True, slots=True)
class OutputContext:
    """Facts that an output may need of the service."""

    name: str  # of its table
    site: str
    machine: str
    axes: tuple[str, ...] = ()  # names of all axes
    folder: Path | None = None  # state folder; None without
    page: str = ""  # address at which people reach the page; empty if they cannot
    # tells whether a user's name and token fit; None: there are no tokens
    knows: Callable[[str, str], bool | None] = lambda _user, _token: None
    # texts of the page by key, of a language
    words: Callable[[str], Mapping[str, str]] = lambda _language: {}
    # whether it sends one test message while the service may be running beside it
    is_test: bool = False
    gone: tuple[str, ...] = ()  # names of axes that were removed, of which nothing is to stay


@dataclass(frozen=True, slots=True)
class Events:
    """Events from the outbox for one receiver, the oldest first: a single one unless gathered."""

    receiver: str
    events: tuple[Event, ...]


Message = AxisAnswer | Events
"""An axis' answer as it holds now, whose newest supersedes all earlier; or events, never lost."""


class Output(ABC):
    """One system outside that is told about all axes.

    `open`, `take` and `close` may be called in any order and twice; `open` does nothing while it is
    open. Each raises OutputUnavailableError while the other side is away; `take` raises it before
    `open` as well, and RefusedError for events that the other side will never take.
    """

    config_model: ClassVar[type[OutputConfig]]
    open_s: ClassVar[float] = 10.0
    """Longest time that opening takes, s."""
    gather_s: ClassVar[float] = 0.0
    """Events of this time go together, s."""
    most_per_hour: ClassVar[int | None] = None
    """Messages with events in an hour; then events wait, and go together."""
    # whether it is handed answers, each as it changes and at least every second
    takes_answers: bool = True
    # names of those whom events are sent to, each with a queue of its own
    receivers: tuple[str, ...] = ()

    def __init__(self, config: Any, context: OutputContext) -> None:
        self.config, self.context = config, context

    @property
    def kinds(self) -> frozenset[str] | None:
        """Kinds of the events that it takes; None takes all."""
        return None

    @property
    def readings(self) -> dict[str, float]:
        """Values worth seeing, e.g. the number of clients; may be empty."""
        return {}

    def queue(self, receiver: str) -> str:
        """Name of the queue of events for a receiver."""
        return f"{self.context.name}/{receiver}" if receiver else self.context.name

    @abstractmethod
    async def open(self) -> None:
        """Connect, or listen."""

    @abstractmethod
    async def take(self, message: Message) -> None:
        """Pass a message on; returns once the other side has it."""

    @abstractmethod
    async def close(self) -> None:
        """Say goodbye and let go of everything; raises nothing."""


class ListeningConfig(OutputConfig):
    """Base of the tables of outputs that others connect to."""

    scheme: ClassVar[str]
    usual_port: ClassVar[int]
    endpoint: str

    @property
    def place(self) -> tuple[str, int]:
        """Host and port of `endpoint`. Raises ValueError."""
        try:
            parts = urlsplit(self.endpoint)
            host, port = parts.hostname, parts.port
        except ValueError:
            host = port = None
        if not host or parts.scheme != self.scheme or parts.path.strip("/") or parts.username:
            form = f"{self.scheme}://127.0.0.1:{self.usual_port}"
            raise ValueError(f"{self.endpoint!r}: expected an address of the form {form}")
        return host, self.usual_port if port is None else port

    @property
    def is_local(self) -> bool:
        """Nobody beyond this machine can connect. Raises ValueError."""
        return is_loopback(self.place[0])


def value_at(content: Any, path: str) -> Any:
    """Value at a path of members such as `estimate.drag_torque_nm.low`; None if there is none."""
    for name in path.split("."):
        content = None if content is None else getattr(content, name)
    return content


def load_output(name: str) -> type[Output]:
    """The class of an output. Raises UnknownPluginError."""
    found: type[Output] = load_plugin(ENTRY_POINT_GROUP, name)
    return found
