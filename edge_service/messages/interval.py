"""A value with its bounds, times as JSON has them, and the base of every JSON payload."""

import math
from typing import Annotated

import numpy as np
from pydantic import (
    AwareDatetime,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    PlainSerializer,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
)

LAST_S = 253402300799.0
"""The end of the year 9999, the last that RFC 3339 can write, in UNIX seconds."""
_MOMENT = TypeAdapter(AwareDatetime)
_MOST_MORE = 3  # decimals that are added at most


class Frozen(BaseModel):
    """Base of every JSON payload: immutable, unknown keys refused, no NaN on the wire."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        validate_by_name=True,
        validate_by_alias=True,
        serialize_by_alias=True,
    )


class Interval(Frozen):
    """A value with the interval that holds the truth with the estimate's `level`."""

    value: float
    low: float
    high: float

    def times(self, factor: float) -> "Interval":
        """The interval in another unit, of a positive factor."""
        return Interval(value=self.value * factor, low=self.low * factor, high=self.high * factor)


def rfc3339(time_ns: int) -> str:
    """UNIX time in ns, as `rfc3339_s`."""
    return rfc3339_s(time_ns / 1e9)


def rfc3339_s(time_s: float) -> str:
    """UNIX time in s as `2026-01-31T12:00:00.000Z`; times out of its years are clipped."""
    milliseconds = round(min(max(time_s, 0.0), LAST_S) * 1e6) // 1000
    return f"{np.datetime64(milliseconds, 'ms')}Z"


def parse_moment(text: str) -> float:
    """UNIX time in s from RFC 3339 or from UNIX seconds; ValueError says what was expected."""
    try:
        time_s = float(text)
    except ValueError:
        try:
            time_s = _MOMENT.validate_python(text.strip()).timestamp()
        except ValidationError:
            raise ValueError(
                f"{text!r} is not a time: expected RFC 3339 with its offset from UTC, such as "
                "2026-01-31T12:00:00Z, or UNIX seconds"
            ) from None
    if not 0.0 <= time_s <= LAST_S:
        raise ValueError(f"{text!r} is outside the years 1970 to 9999")
    return time_s


EXACT = "exact"
"""Context of `model_dump_json` that keeps times to the ns, as integers: for what is stored."""
TimeNs = Annotated[
    int,
    BeforeValidator(
        lambda raw: round(parse_moment(raw) * 1000.0) * 1_000_000 if isinstance(raw, str) else raw
    ),
    PlainSerializer(
        lambda ns, info: ns if info.context == EXACT else rfc3339(ns), when_used="json"
    ),
    WithJsonSchema(
        {"type": "string", "format": "date-time", "examples": ["2026-01-31T12:00:00.000Z"]}
    ),
]
"""UNIX time in ns; in JSON RFC 3339 in UTC, with milliseconds."""


def printed(value: float, low: float, high: float, decimals: int = 0) -> tuple[str, str, str]:
    """Value, low and high as decimals: bounds are rounded outwards, the value lies off both.

    Where the usual decimals would put the value on a bound, some are added; a value that truly is
    its bound is printed so.

    >>> printed(103.6, 97.2, 103.9)
    ('103.6', '97.2', '103.9')
    >>> printed(0.4, 0.0, 4.0)
    ('0.4', '0', '4')
    """
    for more in range(decimals, decimals + _MOST_MORE + 1):
        middle, least, most = _scaled(value, low, high, 10**more)
        if least < middle < most:
            decimals = more
            break
    whole = _scaled(value, low, high, 10**decimals)
    middle_text, least_text, most_text = (f"{each / 10**decimals:.9g}" for each in whole)
    return middle_text, least_text, most_text


def _scaled(value: float, low: float, high: float, scale: int) -> tuple[int, int, int]:
    """Whole numbers of the last decimal; binary fractions are no reason to round on."""
    least = math.floor(round(low * scale, 6))
    most = math.ceil(round(high * scale, 6))
    return min(max(round(value * scale), least), most), least, most
