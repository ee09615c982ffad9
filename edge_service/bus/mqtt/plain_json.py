"""Plain JSON: every payload as it is on the bus, on a topic of its own."""

from collections.abc import Mapping, Sequence

from ..spool.message import Message
from .packet import GONE, Packet


class PlainJson:
    """Topics `{root}/{axis}/{topic}`, and whether we are there on `{root}/online`, retained."""

    def __init__(self, root: str) -> None:
        self._root = root
        self.commands: str | None = None
        self.described: str | None = None

    def will(self, session: int) -> Packet:
        """`false` to whoever asks."""
        return self._online(b"false")

    def farewell(self) -> Packet:
        """The same."""
        return self._online(b"false")

    def greeting(self, newest: Mapping[str, Message]) -> list[Packet]:
        """`true` to whoever asks."""
        return [self._online(b"true")]

    def packets(self, message: Message, newest: Mapping[str, Message], late: bool) -> list[Packet]:
        """The payload; its own time tells how late it is."""
        if message.topic.endswith(f"/{GONE}"):
            return []  # the condition UNAVAILABLE says it
        return [Packet(f"{self._root}/{message.topic}", message.payload, qos=1)]

    def asks_for_greeting(self, command: bytes) -> bool:
        """False: nobody can ask."""
        return False

    def outdated(self, topic: str, payload: bytes) -> Sequence[Packet]:
        """Nothing: no description is kept."""
        return ()

    def _online(self, payload: bytes) -> Packet:
        return Packet(f"{self._root}/online", payload, qos=1, retain=True)
