"""`edge-service rollout pack`: configurations of the machines of a site as one signed file."""

import hashlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path, PurePath
from zipfile import ZIP_STORED, ZipFile, ZipInfo

from pydantic import BaseModel

from drivers.registry import UnknownDriverError, load_driver

from ... import __version__
from ...atomic import replaced_bytes
from ...clock import now_ns
from ...command_answer import Answer
from ...config import DEFAULT_MACHINE, EdgeConfig, configuration_digest, load_elsewhere, load_fleet
from ...config.loading import load_machine
from ...config_secrets import secret_keys
from ..document import Document
from .bundle import checked_bundle
from .contents import (
    MANIFEST,
    MOST_BYTES,
    SIGNATURE,
    BundledFile,
    BundledMachine,
    Manifest,
    RolloutError,
    check_machine,
    check_name,
    member,
    minor,
    signed_text,
)
from .keys import signer_of, signing_key
from .toml_text import flat, is_secret, stays_there

_SAME_TIME = (1980, 1, 1, 0, 0, 0)
_KEY = b"PRIVATE KEY-----"


class PackedBundle(Document):
    """A bundle that was written; what it does not hold `stays` on the machines."""

    out: str
    site: str
    number: int
    machines: list[str]
    signer: str
    stays: list[str]


def pack(
    configs: Sequence[Path],
    key: Path,
    out: Path,
    *,
    number: int,
    made: datetime | None = None,
    versions: Sequence[str] = (),
    fleet: str | None = None,
) -> Answer:
    """Write a bundle; the same input, number and time give the same bytes.

    Args:
        configs: configuration of each machine; its machine files lie beside it.
        key: private key that signs.
        number: rises with every bundle of the site.
        made: time to state; now unless given.
        versions: minor versions of edge-service that it is for; this one unless given.
        fleet: name of a fleet file beside the configurations; machines without one have none.

    Raises:
        RolloutError, ConfigError: something is wrong, or a secret would leave its machine; then
            nothing was written.
    """
    signer = signing_key(key)
    packed: dict[str, tuple[BundledMachine, Mapping[str, bytes]]] = {}
    sites = set()
    for path in configs:
        config = load_elsewhere(path)
        machine = check_machine(config.service.machine)
        if machine in packed:
            raise RolloutError(f"{path}: service.machine: {machine!r} is another one's name too")
        sites.add(config.service.site)
        packed[machine] = _machine(path, config, fleet)
    if len(sites) != 1:
        raise RolloutError(f"a bundle is for one site; these are of {', '.join(sorted(sites))}")
    manifest = Manifest(
        site=sites.pop(),
        number=number,
        made=(made or datetime.fromtimestamp(now_ns() / 1e9, UTC))
        .astimezone(UTC)
        .isoformat(timespec="seconds"),
        made_by=__version__,
        versions=tuple(versions) or (minor(__version__),),
        machines={name: packed[name][0] for name in sorted(packed)},
    )
    written = manifest.model_dump_json().encode()
    members = {MANIFEST: written, SIGNATURE: signer.sign(signed_text(written))}
    for name in sorted(packed):
        members |= {member(name, file): text for file, text in packed[name][1].items()}
    _write(out, members)
    return _told(out, manifest, signer_of(signer.public_key()))


def next_number(out: Path, key: Path) -> int:
    """The number after that of the bundle that lies where one is to be written; 1 without one.

    Raises:
        RolloutError: what lies there was not signed by the same key.
    """
    if not out.exists():
        return 1
    return checked_bundle(out, signing_key(key).public_key(), str(key)).manifest.number + 1


def _machine(
    path: Path, config: EdgeConfig, fleet: str | None
) -> tuple[BundledMachine, Mapping[str, bytes]]:
    """Files of one machine, in the order of their names."""
    found = {path.name: _read(path)}
    machines = {}
    for axis in config.axes:
        if axis.machine == DEFAULT_MACHINE:
            machines[axis.name] = _read(DEFAULT_MACHINE)
            continue
        name = _beside(axis.machine, f"{path}: axes.{axis.name}.machine")
        load_machine(path.parent / name)
        found[name] = machines[axis.name] = _read(path.parent / name)
    if fleet is not None and (path.parent / fleet).exists():
        found[_beside(PurePath(fleet), "--fleet")] = _read(path.parent / fleet)
        load_fleet(path.parent / fleet)
    keys = {name: flat(found[name], str(path.parent / name)) for name in found}
    for name, values in keys.items():
        _refuse_secrets(path.parent / name, found[name], values)
    _refuse_driver_secrets(path, config)
    stays = {
        f"{key} = {value}"
        for each in keys.values()
        for key, value in each.items()
        if stays_there(key, value)
    }
    described = BundledMachine(
        config=path.name,
        configuration=configuration_digest(found[path.name], machines),
        files={
            name: BundledFile(length=len(text), sha256=hashlib.sha256(text).hexdigest())
            for name, text in sorted(found.items())
        },
        stays=tuple(sorted(stays)),
    )
    return described, dict(sorted(found.items()))


def _beside(name: PurePath, where: str) -> str:
    """Name of a file within the configuration's folder. Raises RolloutError."""
    try:
        check_name(name.as_posix())
    except RolloutError:
        raise RolloutError(f"{where}: {name} does not lie beside the configuration") from None
    return name.as_posix()


def _read(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES)
    except OSError as error:
        raise RolloutError(f"{path}: {error.strerror}") from None
    return content


def _refuse_secrets(path: Path, content: bytes, values: Mapping[str, object]) -> None:
    if _KEY in content:
        raise RolloutError(f"{path}: holds a private key, which must not leave its machine")
    for key, value in values.items():
        if is_secret(key, value):
            raise RolloutError(f"{path}: {key}: a secret stands in the file; name a file of it")


def _refuse_driver_secrets(path: Path, config: EdgeConfig) -> None:
    """Drivers know which of their keys are secret; one that is not installed here is not asked."""
    for axis in config.axes:
        model: type[BaseModel] | None = None
        with suppress(UnknownDriverError):
            model = load_driver(axis.driver).config_model
        for key in () if model is None else secret_keys(model):
            if key in axis.settings:
                where = f"{path}: axes.{axis.name}.settings.{key}"
                raise RolloutError(f"{where}: a secret stands in the file; name a file of it")


def _write(out: Path, members: Mapping[str, bytes]) -> None:
    """Write the archive: the same members give the same bytes."""
    try:
        with replaced_bytes(out) as file, ZipFile(file, "w") as archive:
            for name, content in members.items():
                info = ZipInfo(name, _SAME_TIME)
                info.compress_type, info.create_system = ZIP_STORED, 3
                info.external_attr = 0o100644 << 16
                archive.writestr(info, content)
            if file.tell() > MOST_BYTES:
                raise RolloutError(f"{out}: would be larger than {MOST_BYTES / 1e6:.0f} MB")
    except OSError as error:
        raise RolloutError(f"{error.filename or out}: {error.strerror}") from None


def _told(out: Path, manifest: Manifest, signer: str) -> Answer:
    stays = sorted(
        f"{name}: {each}" for name, machine in manifest.machines.items() for each in machine.stays
    )
    packed = PackedBundle(
        out=str(out),
        site=manifest.site,
        number=manifest.number,
        machines=list(manifest.machines),
        signer=signer,
        stays=stays,
    )
    lines = [f"not in the bundle, stays on the machine: {each}" for each in stays]
    lines.append(
        f"{out}: bundle {packed.number} of site {packed.site} for "
        f"{', '.join(packed.machines)}, signed by the key {signer}"
    )
    return Answer("\n".join(lines), packed)
