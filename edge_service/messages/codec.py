"""Topics: key, times, limits and bytes of their payloads, and the header of each payload.

What has passed holds finite numbers, integers of 64 bits, and texts and lists of limited length, so
that whoever reads it may count on that.
"""

import json
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Generic, NoReturn, TypeVar

from pydantic import BaseModel

from .keys import check_part

JSON_ENCODING = "application/json"
LARGEST = 2**63 - 1
FURTHEST = 1e50
"""No measured or computed number lies beyond; its powers can still be computed with."""
MOST_DEPTH = 8
MOST_TEXT = 4096  # characters of one text
MOST_ENTRIES = 1024  # values in one list, or keys in one object
T = TypeVar("T")
_Payload = TypeVar("_Payload", bound=BaseModel)


class CodecError(ValueError):
    """Bytes that are no payload of ours."""


@dataclass(frozen=True, slots=True)
class Header:
    """Identity and times of one payload."""

    sequence: int  # counts up by one per payload and publisher, from 0; a jump is a loss
    # UNIX time in ns at which the publisher started; a new value means a restart, after which
    # `sequence` begins again
    boot_epoch: int
    source_time_ns: int  # UNIX time in ns of the newest sample that the payload rests on
    monotonic_time_ns: int  # the publishing host's monotonic clock in ns at publication


_HEADER = tuple(each.name for each in fields(Header))


@dataclass(frozen=True)
class Topic(ABC, Generic[T]):
    """One row of the table of topics."""

    name: str  # last part of the key
    schema: str  # name of the payload type and its version, `type/version`
    rate_hz: float  # nominal rate on the wire
    stale_after_s: float  # without a new payload for this long, a reader must treat it as missing
    most_bytes: int  # a longer payload is refused unread
    most_hz: float  # more payloads of one key than this, over a second, are refused unread
    # a query on the same key is answered with the last payload
    keeps_last: bool = field(default=True, kw_only=True)
    # payloads that a publisher keeps for readers that come later, or were away
    cached: int = field(default=0, kw_only=True)
    encoding: ClassVar[str]
    """The Zenoh encoding that a publisher declares."""

    @abstractmethod
    def encode(self, axis: str | None, header: Header, payload: T) -> bytes:
        """Bytes of a payload with its axis and header."""

    @abstractmethod
    def decode(self, payload: bytes) -> tuple[str, Header, T]:
        """Axis (empty if none), header and payload. Raises CodecError."""

    def check(self, payload: T) -> None:
        """Raise CodecError where the bytes of a payload could not be decoded."""

    @abstractmethod
    def description(self) -> dict[str, Any]:
        """JSON schema of the payload, or the columns of a binary block."""

    def members(self, axis: str | None, header: Header) -> dict[str, Any]:
        """Members of every message."""
        return {"schema": self.schema, "axis": axis, **{n: getattr(header, n) for n in _HEADER}}

    def taken(self, members: dict[str, Any]) -> tuple[str, Header]:
        """Axis (empty if none) and header, the latter taken out. Raises CodecError."""
        schema, axis = members.pop("schema", None), members.get("axis", 0)
        if schema != self.schema:
            raise CodecError(f"{schema!r:.40} where {self.schema} was expected")
        numbers = [members.pop(name, None) for name in _HEADER]
        if not all(type(each) is int and 0 <= each <= LARGEST for each in numbers):
            raise CodecError("a header without its four integers of 63 bits")
        try:
            return check_part(axis) if axis not in (None, "") else "", Header(*numbers)
        except (TypeError, ValueError):
            raise CodecError("an axis that is no name") from None

    def described(self) -> dict[str, Any]:
        """JSON schema of the members of every message."""
        own = {"schema": {"const": self.schema}, "axis": {"type": ["string", "null"]}}
        return own | {name: {"type": "integer"} for name in _HEADER}


@dataclass(frozen=True)
class JsonTopic(Topic[_Payload]):
    """Topic of one model: its members beside those of every message."""

    model: type[_Payload]
    strict: bool = True  # refuse values of another type even where they could be converted
    encoding = JSON_ENCODING

    def encode(self, axis: str | None, header: Header, payload: _Payload) -> bytes:
        members = self.members(axis, header) | payload.model_dump(mode="json")
        return json.dumps(members, allow_nan=False).encode()

    def decode(self, payload: bytes) -> tuple[str, Header, _Payload]:
        try:
            members = parse_object(payload)
            check_bounded(members)
            axis, header = self.taken(members)
            if "axis" not in self.model.model_fields:
                del members["axis"]
            text = json.dumps(members)
            return axis, header, self.model.model_validate_json(text, strict=self.strict)
        except CodecError:
            raise
        except (ValueError, RecursionError) as error:
            raise CodecError(f"no {self.schema} message: {error}") from error

    def description(self) -> dict[str, Any]:
        schema, own = self.model.model_json_schema(), self.described()
        schema["properties"] = own | schema["properties"]
        schema["required"] = [*dict.fromkeys([*own, *schema.get("required", [])])]
        return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema


def parse_object(text: bytes) -> dict[str, Any]:
    """Members of a JSON object. Raises ValueError, RecursionError."""
    members = _DECODER.decode(text.decode())
    if not isinstance(members, dict):
        raise ValueError("no object")
    return members


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number of JSON")


_DECODER = json.JSONDecoder(parse_constant=_refuse)


def check_bounded(values: Any, depth: int = MOST_DEPTH) -> None:
    """Raise ValueError where an object or a list holds what nobody may count on."""
    if depth == 0:
        raise ValueError(f"nested deeper than {MOST_DEPTH}")
    if len(values) > MOST_ENTRIES:
        raise ValueError(f"more than {MOST_ENTRIES} entries")
    for each in (*values, *values.values()) if isinstance(values, dict) else values:
        if isinstance(each, str):
            if len(each) > MOST_TEXT:
                raise ValueError(f"a text of more than {MOST_TEXT} characters")
            each.encode()  # a lone surrogate cannot be written anywhere
        elif isinstance(each, dict | list):
            check_bounded(each, depth - 1)
        elif isinstance(each, int):
            if abs(each) > LARGEST:
                raise ValueError("an integer of more than 64 bits")
        elif each is not None and not abs(each) <= FURTHEST:  # 1e999 is infinite
            raise ValueError("a number beyond all bounds")
