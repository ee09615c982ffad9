"""An event with its number."""

from dataclasses import dataclass

from ...messages.event import Event


@dataclass(frozen=True, slots=True)
class LoggedEvent:
    """An event with the number under which readers know it."""

    id: int
    event: Event
