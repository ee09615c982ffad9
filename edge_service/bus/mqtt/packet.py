"""Packets to a broker, and the forms that they may have."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

from ..spool.message import Message

GONE = "gone"
"""Topic of a message that says that nothing is heard from the axis any more."""


@dataclass(frozen=True, slots=True)
class Packet:
    """One MQTT message; `qos` is its quality of service."""

    topic: str
    payload: bytes
    qos: int
    retain: bool = False


class PayloadForm(Protocol):
    """Form in which the messages of a spool, with topics `{axis}/{topic}`, are sent to a broker.

    Attributes:
        commands: topic on which the broker's clients may ask for something; None without.
        described: topics of what is kept at the broker about us and others; None without.
    """

    commands: str | None
    described: str | None

    def will(self, session: int) -> Packet:
        """Packet that the broker sends for us should we be lost; begins connection `session`."""

    def farewell(self) -> Packet:
        """Packet that we send before we leave."""

    def greeting(self, newest: Mapping[str, Message]) -> list[Packet]:
        """Packets sent first in a connection, or again when asked; `newest` by topic."""

    def packets(self, message: Message, newest: Mapping[str, Message], late: bool) -> list[Packet]:
        """A message on its way; `late` if it is from before the connection."""

    def asks_for_greeting(self, command: bytes) -> bool:
        """Tell whether a command wants the greeting again."""

    def outdated(self, topic: str, payload: bytes) -> Sequence[Packet]:
        """Packets that take back what is kept at the broker and no longer so."""
