"""JSON messages: the members of the header beside those of the payload, and a `schema` member."""

import json
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from ..estimate import Frozen
from ..header import Header
from .interface import CodecError, header_members, header_schema, take_header

JSON_ENCODING = "application/json"
_Payload = TypeVar("_Payload", bound=Frozen)


@dataclass(frozen=True, slots=True)
class JsonCodec(Generic[_Payload]):
    """Codec of one model."""

    schema: str
    model: type[_Payload]

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
            members = json.loads(payload)
            if not isinstance(members, dict) or members.pop("schema", None) != self.schema:
                raise CodecError(f"no {self.schema} message")
            header = take_header(members)
            axis = members["axis"] if "axis" in self.model.model_fields else members.pop("axis")
            return axis or "", header, self.model.model_validate_json(json.dumps(members))
        except CodecError:
            raise
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise CodecError(f"no {self.schema} message: {error}") from error

    def description(self) -> dict[str, Any]:
        """JSON schema of a message."""
        schema = self.model.model_json_schema()
        own = {"schema": {"const": self.schema}, "axis": {"type": ["string", "null"]}}
        own |= header_schema()
        schema["properties"] = own | schema["properties"]
        schema["required"] = [*dict.fromkeys([*own, *schema.get("required", [])])]
        return {"$schema": "https://json-schema.org/draft/2020-12/schema"} | schema
