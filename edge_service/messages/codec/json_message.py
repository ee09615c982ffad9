"""JSON messages: the members of the header beside those of the payload, and a `schema` member."""

import json
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import BaseModel

from ..header import Header
from .bounded_json import check_bounded, parse_bounded
from .interface import CodecError, checked_axis, header_members, header_schema, take_header

JSON_ENCODING = "application/json"
_Payload = TypeVar("_Payload", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class JsonCodec(Generic[_Payload]):
    """Codec of one model.

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

    def holds(self, payload: _Payload) -> bool:
        """Tell whether a payload, which its model has checked, keeps the bounds of messages."""
        try:
            check_bounded(payload.model_dump(mode="json"))
        except ValueError:
            return False
        return True

    def description(self) -> dict[str, Any]:
        """JSON schema of a message."""
        schema = self.model.model_json_schema()
        own = {"schema": {"const": self.schema}, "axis": {"type": ["string", "null"]}}
        own |= header_schema()
        schema["properties"] = own | schema["properties"]
        schema["required"] = [*dict.fromkeys([*own, *schema.get("required", [])])]
        return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema
