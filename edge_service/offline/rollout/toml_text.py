"""TOML files as flat keys: for comparison, and to find what must not leave a machine."""

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from ...config.loading import FILE_KEYS, MQTT_FILES
from .contents import RolloutError

_SECRET = re.compile(r"passw|secret|credential|(^|_)token$|api_?key", re.IGNORECASE)
_USER_INFO = re.compile(r"://[^/\s]*@")
_STAYING = {*FILE_KEYS, *MQTT_FILES, "certificates", "keep_folder", "tokens_file"}
HIDDEN = "(hidden)"


def flat(text: bytes, name: str) -> dict[str, Any]:
    """Values of a TOML file by their keys, e.g. `axes.X.driver`.

    Entries of lists of tables are called by their `name`, or by their number. Raises RolloutError.
    """
    try:
        return dict(_flat(tomllib.loads(text.decode()), ""))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RolloutError(f"{name}: is not valid TOML: {error}") from None


def _flat(value: Any, key: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and not _is_quantity(value):
        for name, each in value.items():
            yield from _flat(each, f"{key}.{name}" if key else name)
    elif isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
        names = [each.get("name") for each in value]
        for number, each in enumerate(value, 1):
            name = each.get("name")
            is_own = isinstance(name, str) and names.count(name) == 1
            yield from _flat(each, f"{key}.{name if is_own else number}")
    else:
        yield key, value


def _is_quantity(value: dict[str, Any]) -> bool:
    """Tell whether a table is a number with its tolerance."""
    return "value" in value and set(value) <= {"value", "tolerance"}


def is_secret(key: str, value: Any) -> bool:
    """Tell whether a value must not be seen by others."""
    last = key.rpartition(".")[2]
    named = bool(_SECRET.search(last)) and not last.endswith("_file")
    return named or (key == "webhook.url") or bool(_USER_INFO.search(str(value)))


def stays_there(key: str, value: Any) -> bool:
    """Tell whether a key names a file or folder that stays on its machine."""
    last = key.rpartition(".")[2]
    return isinstance(value, str) and (last in _STAYING or last.endswith("_file"))
