"""Decoding of payloads, once for all subscribers of a process that hear the same bytes."""

from collections import OrderedDict
from typing import Generic

from ..messages.codec.interface import T
from ..messages.header import Header
from ..messages.topics import Topic

MOST_KEPT = 64
LONGEST_KEPT = 16_384
"""Bytes; a longer payload is decoded by everybody who hears it."""


class Decoding(Generic[T]):
    """Decoding of one topic; what is decoded is shared, so its readers must not change it."""

    def __init__(self, topic: Topic[T]) -> None:
        self._topic = topic
        self._recent: OrderedDict[bytes, tuple[str, Header, T]] = OrderedDict()

    def sent(self, payload: bytes, axis: str | None, header: Header, value: T) -> None:
        """Take what this process has encoded: if it keeps all bounds it need not be decoded."""
        if self._topic.holds(value):
            self._keep(payload, (axis or "", header, value))

    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        """Axis, header and payload. Raises CodecError."""
        decoded = self._recent.get(payload)
        if decoded is None:
            decoded = self._topic.decode(payload)
            self._keep(payload, decoded)
        return decoded

    def _keep(self, payload: bytes, decoded: tuple[str, Header, T]) -> None:
        if len(payload) <= LONGEST_KEPT:
            self._recent[payload] = decoded
            if len(self._recent) > MOST_KEPT:
                self._recent.popitem(last=False)
