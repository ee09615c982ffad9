"""Mistakes of a configuration in words: the key, what was wrong, and what was perhaps meant."""

import difflib

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..secret_files import secret_keys


class ConfigError(Exception):
    """A file or key that is wrong; the text is one line."""


def explain(error: ValidationError, model: type[BaseModel]) -> str:
    """The first mistake of a validation as one line, `key: what was wrong`."""
    details = error.errors(include_url=False)
    first = details[0]
    location = _key_path(first["loc"])
    if first["type"] == "extra_forbidden":
        problem = "unknown key" + _closest(first["loc"], model)
    elif first["type"] == "missing":
        problem = "missing"
    else:
        problem = first["msg"].removeprefix("Value error, ")
        if first["type"] != "value_error" and _may_be_shown(first, model):
            problem += f" (got {first['input']!r})"
    more = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    return f"{location}: {problem}{more}" if location else f"{problem}{more}"


def _may_be_shown(mistake: ErrorDetails, model: type[BaseModel]) -> bool:
    """Tell whether what was given is a plain value, and of no key that holds a secret."""
    secret = {key for table in _tables(model) for key in secret_keys(table)}
    return not secret & set(mistake["loc"]) and not isinstance(mistake["input"], dict | list)


def _key_path(location: tuple[int | str, ...]) -> str:
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}"
    return path.removeprefix(".")


def _closest(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """A hint at the table in which a key belongs, or at the known key that was perhaps meant."""
    key, fields = str(location[-1]), model.model_fields.items()
    homes = [name for name, field in fields for each in _within(field) if key in each.model_fields]
    if homes:
        return f" here; it belongs under {' or '.join(f'[{name}]' for name in homes)}"
    known = {name for table in _tables(model) for name in table.model_fields}
    near = difflib.get_close_matches(key, sorted(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""


def _tables(model: type[BaseModel]) -> list[type[BaseModel]]:
    within = [table for field in model.model_fields.values() for table in _within(field)]
    return [model, *(deeper for table in within for deeper in _tables(table))]


def _within(field: FieldInfo) -> list[type[BaseModel]]:
    """Tables that a field holds, one or several of a kind."""
    candidates = (field.annotation, *getattr(field.annotation, "__args__", ()))
    return [each for each in candidates if isinstance(each, type) and issubclass(each, BaseModel)]
