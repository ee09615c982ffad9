"""Mistakes of a configuration in words: the key, what was wrong, what was meant, what is gone."""

import difflib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from ..exit_status import BadInputError
from ..secret_files import secret_keys

GONE: dict[str, str] = {
    "history.folder": "now store.folder",
    "history.budget_mb": "now store.budget_mb",
    "downsample": "gone; edge-service commission --interval states it in the machine file",
    "estimator.activation_exponent": "gone; it is 1.33; edge-service reproduce --exponent",
    "estimator.window_s": "gone; it is 1 s; edge-service reproduce --window",
    "health.warning_percent_of_fresh": "now alarms.warning_percent",
    "health.fault_percent_of_fresh": "now alarms.fault_percent",
    "bus.certificates": "gone; state them in [bus] zenoh_file (deploy/zenoh.json5)",
    "bus.security": "gone; in run others may read; state more in [bus] zenoh_file",
    "bus.tls_endpoint": "gone; state it in [bus] zenoh_file (deploy/zenoh.json5)",
    "webhook": 'gone; put "jsons://HOST/PATH" into the urls_file of [outputs.notify]',
    "email": 'gone; put "mailtos://USER:PASSWORD@HOST" into the urls_file of [outputs.notify]',
    "mqtt": "now [outputs.mqtt], with url for host, port and user",
    "opcua": "now [outputs.opcua], with endpoint for host and port",
    "mtconnect": "now [outputs.mtconnect], with endpoint for host and port",
    "plant": "gone; state the router in [bus] zenoh_file (deploy/zenoh.json5)",
    "http.allowed_hosts": "gone; http.url is the address of a proxy, own names are let in",
    "http.connections": "gone; the limits of a proxy are in its own file (deploy/nginx.conf)",
    "http.tokens_file": "gone; edge-service token CONFIG keeps tokens in the state folder",
    "jobs": "gone; a job ends after an hour, recordings take half of store.budget_mb at most",
}
"""Key with the names of its tables (`bus.security`, `axes.settings.ledger`) -> what to do."""


class ConfigError(BadInputError):
    """Files or keys that are wrong: `mistakes`, a line each. The text is one line.

    Args:
        file: configuration that they are of, all of them shown by check-config.
    """

    def __init__(self, *mistakes: str, file: Path | None = None) -> None:
        more = f"and {len(mistakes) - 1} more"
        shown = more if file is None else f"{more}: `edge-service check-config {file}`"
        super().__init__(mistakes[0] if len(mistakes) == 1 else f"{mistakes[0]} ({shown})")
        self.mistakes = mistakes


def explain(error: ValidationError, model: type[BaseModel], content: Any = None) -> list[str]:
    """The mistakes of a validation, `key: what was wrong` each."""
    found = error.errors(include_url=False)
    above = {each["loc"][:depth] for each in found for depth in range(len(each["loc"]))}
    told = (each for each in found if each["type"] != "too_short" or each["loc"] not in above)
    return [_explained(each, model, content) for each in told]


def _explained(mistake: ErrorDetails, model: type[BaseModel], content: Any) -> str:
    location = key_path(mistake["loc"], content)
    if mistake["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        problem = "unknown key" + _closest(mistake["loc"], model)
    elif mistake["type"] == "missing":
        problem = "missing"
    else:
        problem = mistake["msg"].removeprefix("Value error, ")
        secret = {key for table in _tables(model) for key in secret_keys(table)}
        plain = not isinstance(mistake["input"], dict | list)
        if mistake["type"] != "value_error" and plain and not secret & set(mistake["loc"]):
            problem += f" (got {mistake['input']!r})"
    return f"{location}: {problem}" if location else problem


def key_path(location: tuple[int | str, ...], content: Any = None) -> str:
    """Key with its tables: `axes.X.driver`, or `axes[0].driver` where the axis has no name."""
    path = ""
    for part in location:
        try:
            content = content[part]
        except (LookupError, TypeError):
            content = None
        name = content.get("name") if isinstance(content, dict) else None
        if isinstance(part, str) or (path == ".axes" and isinstance(name, str)):
            path += f".{part if isinstance(part, str) else name}"
        else:
            path += f"[{part}]"
    return path.removeprefix(".")


def _closest(location: tuple[int | str, ...], model: type[BaseModel]) -> str:
    """A hint at the table in which a key belongs, or at the known key that was perhaps meant."""
    key, above, table = str(location[-1]), key_path(location[:-1]), model
    fields = model.model_fields.items()
    homes = [name for name, field in fields for each in _within(field) if key in each.model_fields]
    if homes:
        return f" here; it belongs under {' or '.join(f'[{name}]' for name in homes)}"
    for part in location[:-1]:
        if part in table.model_fields:
            table = next(iter(_within(table.model_fields[part])), table)
    near = difflib.get_close_matches(key, sorted(table.model_fields), n=1)
    return f"; did you mean {f'{above}.{near[0]}'.removeprefix('.')}?" if near else ""


def _tables(model: type[BaseModel]) -> list[type[BaseModel]]:
    within = [table for field in model.model_fields.values() for table in _within(field)]
    return [model, *(deeper for table in within for deeper in _tables(table))]


def _within(field: FieldInfo) -> list[type[BaseModel]]:
    """Tables that a field holds, one or several of a kind."""
    candidates = (field.annotation, *getattr(field.annotation, "__args__", ()))
    return [each for each in candidates if isinstance(each, type) and issubclass(each, BaseModel)]


def gone_keys(content: object) -> list[str]:
    """Gone keys in a parsed configuration, as `key: what to do`."""
    return [f"{key}: {advice}" for key, advice in GONE.items() if _holds(content, key.split("."))]


def _holds(content: object, names: list[str]) -> bool:
    """Presence of a key; in an array of tables that of any of them."""
    if isinstance(content, list):
        return any(_holds(each, names) for each in content)
    table: dict[str, Any] = content if isinstance(content, dict) else {}
    return names[0] in table and (len(names) == 1 or _holds(table[names[0]], names[1:]))
