"""Base of the answers that are no messages: what is shown of the service itself."""

from typing import Annotated

from pydantic import BeforeValidator, ConfigDict, WithJsonSchema

from ..messages.interval import Frozen, rfc3339, rfc3339_s


class Answer(Frozen):
    """Base of answers and requests; it may be made of anything with attributes of these names."""

    model_config = ConfigDict(from_attributes=True)


def _written(time: int | float | str) -> str:
    """A time as it is shown: an integer is UNIX time in ns, a float in s."""
    if isinstance(time, str):
        return time
    return rfc3339(time) if isinstance(time, int) else rfc3339_s(time)


Timestamp = Annotated[
    str,
    BeforeValidator(_written),
    WithJsonSchema(
        {"type": "string", "format": "date-time", "examples": ["2026-01-31T12:00:00.000Z"]}
    ),
]
"""RFC 3339 in UTC, with milliseconds."""


class AcceptedAnswer(Answer):
    """It was taken."""

    accepted: bool = True
