"""Certificates that the nodes of one machine make for themselves, where none are configured."""

import fcntl
import os
from pathlib import Path

from ...bus.access import PUTS, client_name
from ...certificates import AUTHORITY_DAYS, SERVER, make_certificates
from ...config import EdgeConfig

_FOLDER = "@bus"


def own_certificates(config: EdgeConfig) -> Path:
    """Folder of the certificates, made by the first process that asks.

    They are for the user of the service alone: whoever may read them may take part as a node.

    Raises CertificateError, OSError.
    """
    folder = _folder(config)
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    with (folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not all((folder / f"{name}.pem").exists() for name in (SERVER, *PUTS)):
            make_certificates(
                folder, (), {role: client_name(role) for role in PUTS}, AUTHORITY_DAYS
            )
    return folder


def _folder(config: EdgeConfig) -> Path:
    if config.history.folder is not None:
        return config.history.folder / _FOLDER
    home = os.environ.get("XDG_STATE_HOME")
    place = Path(home) if home else Path.home() / ".local" / "state"
    return place / "edge-service" / f"bus-{config.service.site}-{config.service.machine}"
