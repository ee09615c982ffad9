"""Interface of the codecs, and what every payload carries: its axis and its header."""

from dataclasses import fields
from typing import Any, Protocol, TypeVar

from ..header import Header
from ..names import check_part

HEADER_KEYS = tuple(field.name for field in fields(Header))
MOST_HEADER = 2**63
T = TypeVar("T")


class CodecError(ValueError):
    """Bytes that are no payload of ours."""


class Codec(Protocol[T]):
    """Translation of one payload type.

    Attributes:
        schema: name of the payload type and its version, `type/version`.
        encoding: the Zenoh encoding that a publisher declares.
    """

    @property
    def schema(self) -> str: ...

    @property
    def encoding(self) -> str: ...

    def encode(self, axis: str | None, header: Header, payload: T) -> bytes:
        """Bytes of a payload."""
        ...

    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        """Axis (empty if none), header and payload. Raises CodecError."""
        ...

    def holds(self, payload: T) -> bool:
        """Tell whether `decode` would give just this payload again, all of its bounds kept.

        A codec whose payloads come from machines says no: their bytes are read, and checked.
        """
        ...

    def description(self) -> dict[str, Any]:
        """JSON schema of the payload, or the columns of a binary block."""
        ...


def header_members(header: Header) -> dict[str, int]:
    """Members of a message for its header."""
    return {key: getattr(header, key) for key in HEADER_KEYS}


def header_schema() -> dict[str, Any]:
    """JSON schema of those members."""
    return {key: {"type": "integer"} for key in HEADER_KEYS}


def take_header(members: dict[str, Any]) -> Header:
    """Remove the header from the members of a message. Raises CodecError."""
    values = [members.pop(key, None) for key in HEADER_KEYS]
    numbers = [each for each in values if type(each) is int and 0 <= each < MOST_HEADER]
    if len(numbers) < len(HEADER_KEYS):
        raise CodecError("a header without its four integers of 63 bits")
    return Header(*numbers)


def checked_axis(members: dict[str, Any]) -> str:
    """Axis of a message, empty if none. Raises CodecError."""
    axis = members.get("axis", 0)
    if axis is None or axis == "":
        return ""
    try:
        return check_part(axis)
    except (TypeError, ValueError):
        raise CodecError("an axis that is no name") from None
