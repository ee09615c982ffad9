"""Identity of a configuration: a short digest of its files, and the bundle that they came in.

Whoever tells others who runs what (the API, the metrics, reports to a plant) takes
`config.identity` of the configuration that the service was started with.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

ROLLOUT, CURRENT, APPLIED = ".rollout", "current", "applied.json"
"""End of the name of the folder beside a configuration that holds what was rolled out; within it
the link to the state in place, and within that its description."""
DIGITS = 12


@dataclass(frozen=True, slots=True)
class ConfigurationIdentity:
    """Identity of a configuration.

    Attributes:
        digest: short, hexadecimal, of the configuration and the machine files of its axes: equal
            wherever a service is configured by the same content; empty where there is no file.
        bundle: number of the bundle that put these very files in place; None if none did, or if
            one of them has been changed since.
    """

    digest: str = ""
    bundle: int | None = None

    @property
    def words(self) -> str:
        """Both in one text, e.g. `3f2a9c01d4e5 (bundle 7)`; empty if not known."""
        return self.digest if self.bundle is None else f"{self.digest} (bundle {self.bundle})"


class Applied(BaseModel):
    """Description of a state that was put in place; members of a later version are left unread.

    Attributes:
        number: of its bundle; None for what people had written themselves.
        site, machine: that it is for.
        made: when it was packed or, without a bundle, set aside; UTC, ISO 8601.
        made_by: version of edge-service that packed it.
        configuration: digest of the configuration, as `configuration_digest` makes it.
        signer: short digest of the public key that it was checked with; empty without a bundle.
        files: sha256 of every file, by its name relative to the configuration's folder.
        before: name of the state before it; empty if there was none.
    """

    model_config = ConfigDict(frozen=True, extra="ignore")

    number: int | None
    site: str
    machine: str
    made: str
    made_by: str
    configuration: str
    signer: str
    files: dict[str, str]
    before: str


def configuration_digest(config: bytes, machines: Mapping[str, bytes]) -> str:
    """Short digest of a configuration.

    Args:
        config: content of the configuration file.
        machines: content of the machine file of each axis, by the axis' name.
    """
    files = {axis: hashlib.sha256(content).hexdigest() for axis, content in machines.items()}
    described = json.dumps([hashlib.sha256(config).hexdigest(), files], sort_keys=True)
    return hashlib.sha256(described.encode()).hexdigest()[:DIGITS]


def state_in_place(config: Path) -> Path | None:
    """Folder with the files of the state in place; None where the configuration is not of one.

    No later roll-out changes what lies there. So whoever reads several files, or one again after a
    while, must ask once and read there, or may find files of two states.
    """
    folder = config.resolve().parent
    return folder if config.is_symlink() and _holds(config, folder) else None


def machine_file(config: Path, state: Path | None, name: Path) -> Path:
    """Path of a machine file that a configuration names, in the same state if it is of one.

    Args:
        state: folder of the state that the configuration was read from, if it was.
        name: of the file, as it stands in the configuration.
    """
    path = config.parent / name
    governed = state is not None and path.is_symlink() and _holds(config, path.resolve())
    return state / name if state is not None and governed else path


def _holds(config: Path, path: Path) -> bool:
    """Tell whether a path without links lies among the states of a configuration."""
    root = config.with_name(config.name + ROLLOUT)
    return path.is_relative_to(root.resolve())


def identity_of(
    config: Path, state: Path | None, content: bytes, machine_files: Mapping[str, Path]
) -> ConfigurationIdentity:
    """Identity of a configuration that was just read.

    Args:
        state: folder of the state that it was read from, if it was.
        content: what was read.
        machine_files: the machine file of each axis, by the axis' name.
    """
    digest = configuration_digest(content, {a: _content(p) for a, p in machine_files.items()})
    current = config.with_name(config.name + ROLLOUT) / CURRENT
    applied = _applied(current if state is None else state.parent)
    fits = applied is not None and applied.configuration == digest
    return ConfigurationIdentity(digest, applied.number if applied and fits else None)


def _applied(state: Path) -> Applied | None:
    """Description of a state; None if there is none, or it is unreadable."""
    try:
        return Applied.model_validate_json((state / APPLIED).read_bytes())
    except (OSError, ValidationError):
        return None


def _content(path: Path) -> bytes:
    """Content of a file; nothing for one that whoever needs it will find missing."""
    try:
        return path.read_bytes()
    except OSError:
        return b""
