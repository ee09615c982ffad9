"""Keys of roll-outs: Ed25519, a private one that signs bundles and a public one to trust."""

import hashlib
from pathlib import Path

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from ...atomic import PRIVATE, replaced_file
from ...command_answer import Answer
from ...secret_files import MOST_BYTES, SecretError, read_secret
from ..document import Document
from .contents import RolloutError, signed_text

_PEM = serialization.Encoding.PEM


class RolloutKeys(Document):
    """A pair of keys that was made."""

    private: str
    public: str
    signer: str


def make_keys(path: Path) -> Answer:
    """Write a new pair of keys: `path` for its owner alone, and beside it `....pem` for all.

    Raises:
        RolloutError: one of the two is there already, or the folder cannot be written.
    """
    public_path = path.with_name(f"{path.name.removesuffix('.key')}.pem")
    for each in (path, public_path):
        if each.exists():
            raise RolloutError(f"{each}: is there already; a lost key cannot be made again")
    key = Ed25519PrivateKey.generate()
    public = key.public_key()
    private_pem = key.private_bytes(
        _PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    public_pem = public.public_bytes(_PEM, serialization.PublicFormat.SubjectPublicKeyInfo)
    try:
        for place, content, mode in ((path, private_pem, PRIVATE), (public_path, public_pem, None)):
            with replaced_file(place, *(() if mode is None else (mode,))) as file:
                file.write(content.decode("ascii"))
    except OSError as error:
        raise RolloutError(f"{error.filename or path}: {error.strerror}") from None
    made = RolloutKeys(private=str(path), public=str(public_path), signer=signer_of(public))
    lines = (
        f"{path}: signs bundles; keep it off the machines, and a copy of it in a safe",
        f"{public_path}: machines trust it (--trust); its digest is {made.signer}",
    )
    return Answer("\n".join(lines), made)


def signing_key(path: Path) -> Ed25519PrivateKey:
    """The private key in a file that nobody but its owner can read. Raises RolloutError."""
    try:
        key = serialization.load_pem_private_key(read_secret(path).encode(), None)
    except SecretError as error:
        raise RolloutError(str(error)) from None
    except (ValueError, TypeError, UnsupportedAlgorithm):
        raise RolloutError(f"{path}: expected a key of `edge-service rollout key`") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise RolloutError(f"{path}: expected an Ed25519 key, of `edge-service rollout key`")
    return key


def trusted_key(path: Path) -> Ed25519PublicKey:
    """The public key in a file. Raises RolloutError."""
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES)
        key = serialization.load_pem_public_key(content)
    except OSError as error:
        raise RolloutError(f"{path}: {error.strerror}") from None
    except (ValueError, UnsupportedAlgorithm):
        raise RolloutError(f"{path}: expected the public key that signed bundles") from None
    if not isinstance(key, Ed25519PublicKey):
        raise RolloutError(f"{path}: expected an Ed25519 key, of `edge-service rollout key`")
    return key


def signer_of(key: Ed25519PublicKey) -> str:
    """Short digest of a public key, for people to compare."""
    raw = key.public_bytes(serialization.Encoding.Raw, serialization.PublicFormat.Raw)
    return hashlib.sha256(raw).hexdigest()[:16]


def is_signed(manifest: bytes, signature: bytes, key: Ed25519PublicKey) -> bool:
    """Tell whether a manifest was signed by the owner of a key."""
    try:
        key.verify(signature, signed_text(manifest))
    except InvalidSignature:
        return False
    return True
