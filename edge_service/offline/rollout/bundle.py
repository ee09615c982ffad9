"""A bundle read and checked before anything of it is believed, and shown."""

import hashlib
import io
import json
import stat
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZIP_STORED, BadZipFile, ZipFile, ZipInfo

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
from pydantic import ValidationError

from ...command_answer import Answer
from ..document import Document
from .contents import (
    MANIFEST,
    MOST_BYTES,
    MOST_FILES,
    MOST_MANIFEST_BYTES,
    SCHEMA,
    SIGNATURE,
    BundledMachine,
    Manifest,
    RolloutError,
    check_machine,
    check_name,
    member,
)
from .keys import is_signed, signer_of, trusted_key

_DAMAGE = (BadZipFile, EOFError, NotImplementedError, RuntimeError, ValueError, zlib.error)
_SIGNATURE_BYTES = 64


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle whose signature holds and whose files are those that were signed.

    Attributes:
        files: content by machine and name.
        signer: short digest of the key that it was checked with.
    """

    manifest: Manifest
    files: Mapping[str, Mapping[str, bytes]]
    signer: str


class ShownMachine(Document):
    """Files of one machine of a bundle."""

    machine: str
    configuration: str
    files: list[str]
    stays: list[str]


class ShownBundle(Document):
    """A bundle whose signature holds."""

    site: str
    number: int
    made: str
    made_by: str
    versions: list[str]
    signer: str
    machines: list[ShownMachine]


def open_bundle(path: Path, trust: Path) -> Bundle:
    """Read a bundle, whole, and check it.

    Args:
        trust: public key of whoever may sign.

    Raises:
        RolloutError: it is damaged, hostile, of a later format, or signed by somebody else.
    """
    return checked_bundle(path, trusted_key(trust), str(trust))


def checked_bundle(path: Path, key: Ed25519PublicKey, whose: str) -> Bundle:
    """The same with a key that was read before, from the file `whose`."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES:
            raise RolloutError(f"is larger than {MOST_BYTES / 1e6:.0f} MB")
        with ZipFile(io.BytesIO(content)) as archive:
            held = _held(archive)
            written = archive.read(held.pop(MANIFEST))
            if not is_signed(written, archive.read(held.pop(SIGNATURE)), key):
                raise RolloutError(f"is not signed by the owner of {whose}")
            manifest = _understood(written)
            return Bundle(manifest, _files(archive, held, manifest), signer_of(key))
    except OSError as error:
        raise RolloutError(f"{path}: {error.strerror}") from None
    except RolloutError as error:
        raise RolloutError(f"{path}: {error}") from None
    except _DAMAGE as error:
        raise RolloutError(f"{path}: is damaged, or no bundle ({error})") from None


def _held(archive: ZipFile) -> dict[str, ZipInfo]:
    """Members by name: plain files as they are, each once."""
    infos = archive.infolist()
    held = {info.filename: info for info in infos}
    for name, most in ((MANIFEST, MOST_MANIFEST_BYTES), (SIGNATURE, _SIGNATURE_BYTES)):
        if name not in held or held[name].file_size > most:
            raise RolloutError(f"is no bundle: it has no {name}")
    if len(infos) > MOST_FILES or len(held) != len(infos):
        raise RolloutError("is no bundle: it has too many files, or one of them twice")
    for info in infos:
        kind = stat.S_IFMT(info.external_attr >> 16)
        if info.compress_type != ZIP_STORED or kind not in (0, stat.S_IFREG):
            raise RolloutError("is no bundle: something in it is compressed, or no plain file")
    return held


def _understood(written: bytes) -> Manifest:
    described = json.loads(written)
    form = described.get("format") if isinstance(described, dict) else None
    if form != SCHEMA:
        raise RolloutError(f"has the format {form!r:.40}, which only a newer version may know")
    try:
        manifest = Manifest.model_validate(described)
    except ValidationError:
        raise RolloutError("is damaged: its manifest is none") from None
    for name, machine in manifest.machines.items():
        check_machine(name)
        for file in machine.files:
            check_name(file)
        if machine.config not in machine.files:
            raise RolloutError(f"is damaged: it has no configuration of {name}")
    return manifest


def _files(
    archive: ZipFile, held: Mapping[str, ZipInfo], manifest: Manifest
) -> dict[str, dict[str, bytes]]:
    """Content by machine and name, exactly what the manifest says."""
    described = {
        member(machine, name): file
        for machine, each in manifest.machines.items()
        for name, file in each.files.items()
    }
    if set(held) != set(described):
        raise RolloutError("is damaged: it does not hold what its manifest says")
    read = {}
    for name, file in described.items():
        content = archive.read(held[name]) if held[name].file_size == file.length else b""
        if len(content) != file.length or hashlib.sha256(content).hexdigest() != file.sha256:
            raise RolloutError(f"is damaged: {name} is not what was signed")
        read[name] = content
    return {
        machine: {name: read[member(machine, name)] for name in each.files}
        for machine, each in manifest.machines.items()
    }


def show(path: Path, trust: Path) -> Answer:
    """Check a bundle and list what it holds. Raises RolloutError."""
    bundle = open_bundle(path, trust)
    manifest = bundle.manifest
    shown = ShownBundle(
        site=manifest.site,
        number=manifest.number,
        made=manifest.made,
        made_by=manifest.made_by,
        versions=list(manifest.versions),
        signer=bundle.signer,
        machines=[_machine(*each) for each in manifest.machines.items()],
    )
    return Answer("\n".join(_lines(shown)), shown)


def _machine(name: str, machine: BundledMachine) -> ShownMachine:
    return ShownMachine(
        machine=name,
        configuration=machine.configuration,
        files=list(machine.files),
        stays=list(machine.stays),
    )


def _lines(shown: ShownBundle) -> Iterator[str]:
    yield (
        f"bundle {shown.number} of site {shown.site}, packed {shown.made} by edge-service "
        f"{shown.made_by}, for versions {', '.join(shown.versions)}"
    )
    yield f"signed by the key {shown.signer}"
    for each in shown.machines:
        yield f"machine {each.machine}: configuration {each.configuration}"
        yield from (f"  {name}" for name in each.files)
        yield from (f"  stays on the machine: {name}" for name in each.stays)
