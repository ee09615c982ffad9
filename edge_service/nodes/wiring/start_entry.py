"""Entry of the audit log for the start and the end of a process, with the configuration used."""

import getpass
import hashlib
import json
import os
import re
from typing import Any

from ... import __version__
from ...clock import now_ns
from ...config import EdgeConfig
from ...health.events.audit import AuditEntry

_SECRET = re.compile(r"passw|secret|token|private|credential", re.IGNORECASE)
_USER_INFO = re.compile(r"(?<=://)[^/@\s]+@")
_MOST = 20_000


def start_entry(config: EdgeConfig, names: tuple[str, ...]) -> AuditEntry:
    """Entry of a start: version, and the configuration without its secrets."""
    text = json.dumps(_masked(config.model_dump(mode="json")))
    return AuditEntry(
        time_ns=now_ns(),
        who=user_name(),
        origin=f"process {os.getpid()}",
        action="service_started",
        target=" ".join(names),
        outcome="done",
        data={
            "version": __version__,
            "configuration_digest": config.digest,
            "configuration": text[:_MOST],
            "configuration_sha256": hashlib.sha256(text.encode()).hexdigest(),
        },
    )


def end_entry(names: tuple[str, ...]) -> AuditEntry:
    """Entry of an orderly end."""
    return AuditEntry(
        time_ns=now_ns(),
        who=user_name(),
        origin=f"process {os.getpid()}",
        action="service_stopped",
        target=" ".join(names),
        outcome="done",
    )


def user_name() -> str:
    """Name of the user whose process this is."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name
        return str(os.getuid())


def _masked(value: Any, key: str = "") -> Any:
    """A document without passwords, tokens and their like."""
    if isinstance(value, dict):
        return {name: _masked(each, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_masked(each, key) for each in value]
    if value and _SECRET.search(key) and not key.endswith("_file"):
        return "***"
    return _USER_INFO.sub("***@", value) if isinstance(value, str) else value
