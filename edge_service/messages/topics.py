"""The one table of topics: key, payload, encoding, rate, stale-after, keep policy."""

from dataclasses import dataclass
from enum import StrEnum


class Keep(StrEnum):
    """Payloads that a publisher keeps for late comers."""

    LAST = "last"  # the last payload is answered by a queryable on the same key
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Topic:
    """One row of the table.

    Attributes:
        name: last part of the key.
        payload: name of the payload type and its schema version, `type/version`.
        encoding: the Zenoh encoding that the publisher declares.
        rate_hz: nominal rate on the wire.
        stale_after_s: without a new payload for this long, a reader must treat it as missing.
        keep: what is answered to a query.
        best_effort: whether a slow reader may lose payloads (it sees the hole in `sequence`).
    """

    name: str
    payload: str
    encoding: str
    rate_hz: float
    stale_after_s: float
    keep: Keep
    best_effort: bool


BLOCK_ENCODING = "application/octet-stream;edge-block/1"
JSON_ENCODING = "application/json"

RAW = Topic("raw", "samples/1", BLOCK_ENCODING, 50.0, 2.0, Keep.LAST, True)
FEAT = Topic("feat", "features/1", BLOCK_ENCODING, 10.0, 2.0, Keep.LAST, True)
PRELOAD = Topic("preload", "preload/1", JSON_ENCODING, 10.0, 2.0, Keep.LAST, True)
HEALTH = Topic("health", "health/1", JSON_ENCODING, 1.0, 5.0, Keep.LAST, False)
EVENT = Topic("event", "event/1", JSON_ENCODING, 0.0, float("inf"), Keep.LAST, False)
COMMAND = Topic("command", "command/1", JSON_ENCODING, 0.0, float("inf"), Keep.NONE, False)
STATUS = Topic("status", "status/1", JSON_ENCODING, 1.0, 5.0, Keep.LAST, False)
WAVE = Topic("wave", "waveform/1", BLOCK_ENCODING, 50.0, 2.0, Keep.NONE, True)
VIB = Topic("vib", "vibration/1", JSON_ENCODING, 1.0, 5.0, Keep.LAST, True)

TOPICS: dict[str, Topic] = {
    topic.name: topic for topic in (RAW, FEAT, PRELOAD, HEALTH, EVENT, COMMAND, STATUS, WAVE, VIB)
}
