"""JSON of strangers."""

import json
from typing import Any


class MessageError(Exception):
    """A message that is skipped; the text is a part of a line."""


def decode_object(payload: Any) -> dict[str, Any]:
    """The object that a payload holds. Raises MessageError."""
    try:
        content = json.loads(payload)
    except RecursionError:
        raise MessageError("JSON that is nested too deeply") from None
    except (ValueError, TypeError) as error:
        raise MessageError(f"no JSON ({str(error)[:60]})") from None
    if not isinstance(content, dict):
        raise MessageError(f"JSON that is no object but a {type(content).__name__}")
    return content
