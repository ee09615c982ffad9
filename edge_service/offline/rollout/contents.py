"""Contents of a bundle: a ZIP archive without compression, its manifest, and the signature of that.

`manifest.json`, `signature`, and `machines/NAME/...` with the files of each machine.
"""

from pathlib import PurePosixPath
from typing import Literal

from ...messages.estimate import Frozen
from ...messages.names import check_part

MANIFEST, SIGNATURE, MACHINES = "manifest.json", "signature", "machines"
SCHEMA: Literal["rollout/1"] = "rollout/1"
MOST_BYTES = 64_000_000
MOST_MANIFEST_BYTES = 4_000_000
MOST_FILES = 10_000


class RolloutError(Exception):
    """Reason why nothing was packed or put in place; the text is one line."""


class BundledFile(Frozen):
    """One file of a machine: its length in bytes and the sha256 of its content, hexadecimal."""

    length: int
    sha256: str


class BundledMachine(Frozen):
    """Files of one machine.

    Attributes:
        config: name of the configuration file among them.
        configuration: digest of the configuration, as the service will tell it.
        files: by their name relative to the configuration's folder.
        stays: what the configuration names and the bundle does not hold, `key = name`: secrets,
            certificates, what the service writes.
    """

    config: str
    configuration: str
    files: dict[str, BundledFile]
    stays: tuple[str, ...]


class Manifest(Frozen):
    """Description of a bundle.

    Attributes:
        format: of the archive.
        number: rises with every bundle of a site.
        made: when it was packed, UTC, ISO 8601.
        made_by: version of edge-service that packed it.
        versions: minor versions of edge-service that it is for, e.g. `0.1`.
        machines: by the name of the machine on the bus.
    """

    format: Literal["rollout/1"] = SCHEMA
    site: str
    number: int
    made: str
    made_by: str
    versions: tuple[str, ...]
    machines: dict[str, BundledMachine]


def signed_text(manifest: bytes) -> bytes:
    """Bytes that the signature is made over: no other signature by the same key passes for it."""
    return b"edge-service rollout/1\n" + manifest


def member(machine: str, name: str) -> str:
    """Name in the archive of a file of a machine."""
    return f"{MACHINES}/{machine}/{name}"


def check_machine(machine: str) -> str:
    """Return the name of a machine; raise RolloutError for one that could lead elsewhere."""
    try:
        check_part(machine)
    except ValueError as error:
        raise RolloutError(str(error)) from None
    if set(machine) == {"."}:
        raise RolloutError(f"{machine!r} is no name of a machine")
    return machine


def check_name(name: str) -> None:
    """Check a file's name within a folder; raise RolloutError if it could lead elsewhere."""
    parts = name.split("/")
    is_plain = str(PurePosixPath(name)) == name and not parts[0].startswith(".") and parts[0]
    if not is_plain or ".." in parts or "\\" in name or not name.isprintable():
        raise RolloutError(f"{name!r:.80} is no name of a file beside a configuration")


def minor(version: str) -> str:
    """The minor version, e.g. `0.1` of `0.1.3`."""
    return ".".join(version.split(".")[:2])
