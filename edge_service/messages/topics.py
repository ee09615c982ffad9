"""The one table of topics: key, payload with its codec, rate, stale-after, keep policy."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Generic

from .codec import Codec, Header, JsonCodec, T
from .command import Command, Outcome
from .edge_block import FeatureCodec, SampleCodec, WaveformCodec
from .estimate import PreloadEstimate
from .event import Event
from .health import AxisHealth, ComponentHealth


class Keep(StrEnum):
    """Payloads that a publisher keeps for late comers."""

    LAST = "last"  # the last payload is answered by a queryable on the same key
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Topic(Generic[T]):
    """One row of the table.

    Attributes:
        name: last part of the key.
        codec: of its payloads.
        rate_hz: nominal rate on the wire.
        stale_after_s: without a new payload for this long, a reader must treat it as missing.
        keep: what is answered to a query.
        most_bytes: a longer payload is refused unread.
        most_hz: more payloads of one key than this, over a second, are refused unread.
        cached: payloads that a publisher keeps for readers that come later, or were away.
    """

    name: str
    codec: Codec[T]
    rate_hz: float
    stale_after_s: float
    keep: Keep
    most_bytes: int
    most_hz: float
    cached: int = 0

    @property
    def payload(self) -> str:
        """Name of the payload type and its schema version, `type/version`."""
        return self.codec.schema

    @property
    def encoding(self) -> str:
        """The Zenoh encoding that the publisher declares."""
        return self.codec.encoding

    def encode(self, axis: str | None, header: Header, payload: T) -> bytes:
        """Bytes of a payload."""
        return self.codec.encode(axis, header, payload)

    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        """Axis (empty if none), header and payload. Raises CodecError."""
        return self.codec.decode(payload)


_NEVER = float("inf")
_ESTIMATES = JsonCodec("preload/1", PreloadEstimate)
_COMMANDS = JsonCodec("command/1", Command, strict=False)  # as people's programs may send it

RAW = Topic("raw", SampleCodec("samples/1"), 10.0, 2.0, Keep.LAST, 2_000_000, 5000.0)
FEAT = Topic("feat", FeatureCodec("features/1"), 10.0, 2.0, Keep.LAST, 20_000, 5000.0)
PRELOAD = Topic("preload", _ESTIMATES, 10.0, 2.0, Keep.LAST, 20_000, 5000.0)
HEALTH = Topic(
    "health", JsonCodec("health/1", AxisHealth), 1.0, 5.0, Keep.LAST, 100_000, 200.0, cached=600
)
EVENT = Topic("event", JsonCodec("event/1", Event), 0.0, _NEVER, Keep.LAST, 20_000, 100.0)
COMMAND = Topic("command", _COMMANDS, 0.0, _NEVER, Keep.NONE, 20_000, 20.0)
STATUS = Topic("status", JsonCodec("status/1", ComponentHealth), 1.0, 5.0, Keep.LAST, 20_000, 50.0)
WAVE = Topic("wave", WaveformCodec("waveform/1"), 10.0, 2.0, Keep.NONE, 2_000_000, 5000.0)
OUTCOME = Topic("outcome", JsonCodec("outcome/1", Outcome), 0.0, _NEVER, Keep.NONE, 20_000, 20.0)
"""On its key a command is asked as a question, and answered."""

TOPICS: dict[str, Topic[Any]] = {
    topic.name: topic
    for topic in (RAW, FEAT, PRELOAD, HEALTH, EVENT, COMMAND, STATUS, WAVE, OUTCOME)
}
