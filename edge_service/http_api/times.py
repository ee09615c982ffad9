"""Times on the HTTP interface: RFC 3339 in UTC, with milliseconds."""

import math
from datetime import UTC, datetime

_NS_PER_S = 1_000_000_000
LAST_S = 253402300799.0
"""The end of the year 9999, the last that RFC 3339 can write, in UNIX seconds."""


def rfc3339(time_ns: int) -> str:
    """UNIX time in ns as `2026-01-31T12:00:00.000Z`; times out of its years are clipped."""
    return rfc3339_s(time_ns / _NS_PER_S)


def rfc3339_s(time_s: float) -> str:
    """UNIX time in s as `2026-01-31T12:00:00.000Z`; times out of its years are clipped."""
    moment = datetime.fromtimestamp(min(max(time_s, 0.0), LAST_S), UTC)
    return moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def parse_moment(text: str) -> float:
    """UNIX time in s from RFC 3339 or from UNIX seconds; ValueError says what was expected."""
    try:
        time_s = float(text)
    except ValueError:
        time_s = _parse_rfc3339(text)
    if not (math.isfinite(time_s) and 0.0 <= time_s <= LAST_S):
        raise ValueError(f"{text!r} is outside the years 1970 to 9999")
    return time_s


def _parse_rfc3339(text: str) -> float:
    expected = "expected RFC 3339 such as 2026-01-31T12:00:00Z, or UNIX seconds"
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a time: {expected}") from None
    if moment.tzinfo is None:
        raise ValueError(f"{text!r} has no offset from UTC: {expected}")
    return moment.timestamp()
