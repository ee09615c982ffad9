"""Check of the certificates with which processes take part in the bus."""

from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID

from ...bus.access import PUTS, client_name
from ...certificates import AUTHORITY, SERVER
from ...config import BusConfig, ConfigError
from ...secret_files import SecretError, read_secret

NAMES = (SERVER, *PUTS)
"""Of the router, and of each role."""


def check_bus(bus: BusConfig) -> str:
    """Check what `[bus] certificates` names; returns a line on who takes part. ConfigError."""
    folder = bus.certificates
    if folder is None:
        return f"bus: {bus.security}"
    authorities = _certificates(folder / f"{AUTHORITY}.pem")
    there = [name for name in NAMES if _is_there(folder, name)]
    if not there:
        raise _error(folder, f"expected NAME.pem and NAME.key of at least one of {_list(NAMES)}")
    ends = [_checked(folder, name, authorities) for name in there]
    return f"bus: {bus.security}, certificates of {_list(there)} until {min(ends):%Y-%m-%d}"


def _is_there(folder: Path, name: str) -> bool:
    return any((folder / f"{name}.{kind}").exists() for kind in ("pem", "key"))


def _checked(folder: Path, name: str, authorities: list[x509.Certificate]) -> datetime:
    """End of a pair that nothing is wrong with. Raises ConfigError."""
    path, now = folder / f"{name}.pem", datetime.now(UTC)
    chain = _certificates(path)
    if _public_key(folder / f"{name}.key") != chain[0].public_key():
        raise _error(path, f"{name}.key does not belong to it")
    issuer = next((each for each in authorities if _is_signed_by(chain[-1], each)), None)
    if issuer is None or not all(_is_signed_by(*pair) for pair in pairwise(chain)):
        raise _error(path, f"was not signed by {AUTHORITY}.pem")
    for each in (*chain, issuer):
        if now < each.not_valid_before_utc:
            raise _error(path, f"is not valid before {each.not_valid_before_utc:%Y-%m-%d}")
        if now >= each.not_valid_after_utc:
            raise _error(path, f"expired on {each.not_valid_after_utc:%Y-%m-%d}")
    if name in PUTS and client_name(name) not in _common_names(chain[0]):
        raise _error(path, f"does not have the common name {client_name(name)}")
    return min(each.not_valid_after_utc for each in (*chain, issuer))


def _certificates(path: Path) -> list[x509.Certificate]:
    try:
        return x509.load_pem_x509_certificates(path.read_bytes())
    except OSError as error:
        raise _error(path, f"cannot be read ({error.strerror})") from None
    except ValueError:
        raise _error(path, "contains no certificate") from None


def _public_key(path: Path) -> object:
    try:
        return load_pem_private_key(read_secret(path).encode(), None).public_key()
    except SecretError as error:
        raise ConfigError(f"bus.certificates: {error}") from None
    except (ValueError, TypeError):
        raise _error(path, "contains no key, or a key with a password") from None


def _is_signed_by(certificate: x509.Certificate, issuer: x509.Certificate) -> bool:
    try:
        certificate.verify_directly_issued_by(issuer)
        return True
    except (ValueError, TypeError, InvalidSignature):
        return False


def _common_names(certificate: x509.Certificate) -> list[str | bytes]:
    return [each.value for each in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]


def _list(names: tuple[str, ...] | list[str]) -> str:
    return ", ".join(names)


def _error(path: Path, words: str) -> ConfigError:
    return ConfigError(f"bus.certificates: {path}: {words}")
