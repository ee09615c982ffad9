"""Is it a message at which the connection breaks again and again, or is it the broker? Pure."""

from ..spool.message import Message

MOST_BROKEN = 5
"""Connections that may break at the same first message before messages are sent one by one."""
MOST_WITNESSES = 16
"""Messages behind the first that are tried before the broker is taken for sick."""


class Suspicion:
    """Choice of what to send, from what became of what was sent before.

    Once connections have broken at the same first message too often, each gets one message: the
    first, then those behind it, more of them each time. If one is taken, and the connection breaks
    at the first once more, the first is to blame.
    """

    def __init__(self) -> None:
        self._key, self._broken, self._at, self._witnesses, self._is_well = "", 0, 0, 1, False

    @property
    def hurries(self) -> bool:
        """True if the next connection must not wait: a broker that recovers gets all in order."""
        return self._at > 0

    @property
    def tries(self) -> int:
        """Connections that broke at the first message."""
        return self._broken

    def choose(self, oldest: list[Message]) -> list[Message]:
        """The messages to send now, of those that wait."""
        if oldest[0].key != self._key:
            self._begin(oldest[0].key)
        if self._broken < MOST_BROKEN:
            return oldest
        self._at = self._at if self._at < len(oldest) else 0
        return [oldest[self._at]]

    def taken(self) -> None:
        """Note that all that was chosen went."""
        if self._at > 0:
            self._is_well, self._at = True, 0

    def broke(self) -> bool:
        """Note that the connection broke; True if the first message is to blame."""
        if self._is_well:
            return True
        one_by_one = self._broken >= MOST_BROKEN
        self._broken += self._at == 0
        if one_by_one:
            self._at = self._at + 1 if self._at < self._witnesses else 0
            if self._at == 0:
                self._witnesses = min(self._witnesses + 1, MOST_WITNESSES)
        return False

    def _begin(self, key: str) -> None:
        self._key, self._broken, self._at, self._witnesses, self._is_well = key, 0, 0, 1, False
