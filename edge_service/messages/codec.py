"""Codecs: what every payload carries, the bounds of JSON from anybody, and JSON messages.

What has passed holds finite numbers, integers of 64 bits, and texts and lists of limited length, so
that whoever reads it may count on that.
"""

import json
from dataclasses import dataclass, fields
from typing import Any, Generic, NoReturn, Protocol, TypeVar

from pydantic import BaseModel

from .keys import check_part

JSON_ENCODING = "application/json"
LARGEST = 2**63 - 1
FURTHEST = 1e50
"""No measured or computed number lies beyond; its powers can still be computed with."""
MOST_DEPTH = 8
MOST_TEXT = 4096
"""Characters of one text."""
MOST_ENTRIES = 1024
"""Values in one list, or keys in one object."""
T = TypeVar("T")
_Payload = TypeVar("_Payload", bound=BaseModel)


class CodecError(ValueError):
    """Bytes that are no payload of ours."""


@dataclass(frozen=True, slots=True)
class Header:
    """Identity and times of one payload.

    Attributes:
        sequence: counts up by one per payload and publisher, from 0; a jump is a loss.
        boot_epoch: UNIX time in ns at which the publisher started; a new value means a restart,
            after which `sequence` begins again.
        source_time_ns: UNIX time in ns of the newest sample that the payload rests on.
        monotonic_time_ns: the publishing host's monotonic clock in ns at publication.
    """

    sequence: int
    boot_epoch: int
    source_time_ns: int
    monotonic_time_ns: int


HEADER_KEYS = tuple(field.name for field in fields(Header))


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
    numbers = [each for each in values if type(each) is int and 0 <= each <= LARGEST]
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


@dataclass(frozen=True, slots=True)
class JsonCodec(Generic[_Payload]):
    """Codec of one model: its members beside those of the header, and a member `schema`.

    Attributes:
        strict: refuse values of another type even where they could be converted.
    """

    schema: str
    model: type[_Payload]
    strict: bool = True

    @property
    def encoding(self) -> str:
        """The Zenoh encoding."""
        return JSON_ENCODING

    def encode(self, axis: str | None, header: Header, payload: _Payload) -> bytes:
        """Bytes of a payload with its axis and header."""
        members = {"schema": self.schema, "axis": axis} | header_members(header)
        return json.dumps(members | payload.model_dump(mode="json"), allow_nan=False).encode()

    def decode(self, payload: bytes) -> tuple[str, Header, _Payload]:
        """Axis (empty if none), header and payload. Raises CodecError."""
        try:
            members = parse_bounded(payload)
            if members.pop("schema", None) != self.schema:
                raise CodecError(f"no {self.schema} message")
            header, axis = take_header(members), checked_axis(members)
            if "axis" not in self.model.model_fields:
                del members["axis"]
            text = json.dumps(members)
            return axis, header, self.model.model_validate_json(text, strict=self.strict)
        except CodecError:
            raise
        except (ValueError, RecursionError) as error:
            raise CodecError(f"no {self.schema} message: {error}") from error

    def description(self) -> dict[str, Any]:
        """JSON schema of a message."""
        schema = self.model.model_json_schema()
        own = {"schema": {"const": self.schema}, "axis": {"type": ["string", "null"]}}
        own |= header_schema()
        schema["properties"] = own | schema["properties"]
        schema["required"] = [*dict.fromkeys([*own, *schema.get("required", [])])]
        return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema


def parse_bounded(text: bytes) -> dict[str, Any]:
    """Members of a JSON object. Raises ValueError, RecursionError."""
    members = _DECODER.decode(text.decode())
    if not isinstance(members, dict):
        raise ValueError("no object")
    _check(members, MOST_DEPTH)
    return members


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number of JSON")


_DECODER = json.JSONDecoder(parse_constant=_refuse)


def _check(value: Any, depth: int) -> None:
    """Raise ValueError for whatever lies outside the bounds."""
    if isinstance(value, str):
        if len(value) > MOST_TEXT:
            raise ValueError(f"a text of more than {MOST_TEXT} characters")
        value.encode()  # a lone surrogate cannot be written anywhere
    elif isinstance(value, int):
        if abs(value) > LARGEST:
            raise ValueError("an integer of more than 64 bits")
    elif isinstance(value, float):
        if not abs(value) <= FURTHEST:  # 1e999 is infinite
            raise ValueError("a number beyond all bounds")
    elif value is not None:
        if depth == 0:
            raise ValueError(f"nested deeper than {MOST_DEPTH}")
        if len(value) > MOST_ENTRIES:
            raise ValueError(f"more than {MOST_ENTRIES} entries")
        if isinstance(value, dict):
            for name in value:
                _check(name, depth)
            value = value.values()
        for each in value:
            _check(each, depth - 1)
