"""Certificates of a local authority: for the page, the router of the bus and its nodes."""

import ipaddress
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from .atomic import PRIVATE, replaced_file

AUTHORITY = "ca"
SERVER = "server"
LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")
AUTHORITY_DAYS = 3650
_EARLIER = timedelta(minutes=5)
"""For clocks that are a little behind."""


class CertificateError(Exception):
    """Certificates that cannot be made or read; the text is one line."""


@dataclass(frozen=True, slots=True)
class _Issuer:
    """The authority: its certificate and the key that signs with it."""

    certificate: x509.Certificate
    key: ec.EllipticCurvePrivateKey


def make_certificates(
    folder: Path, names: Iterable[str], clients: Mapping[str, str], days: int
) -> tuple[Path, ...]:
    """Write `server` and each of `clients`, signed by the folder's authority; makes one if none.

    Args:
        folder: Gets `NAME.pem` and `NAME.key`, keys readable by their owner alone.
        names: Host names and addresses of the server, besides those of loopback.
        clients: Name of the file -> common name, by which a client proves who it is.
        days: How long they hold.

    Raises:
        CertificateError: a name makes no sense, or the folder cannot be read or written.
    """
    alternatives = [_alternative(name) for name in dict.fromkeys((*names, *LOCAL_NAMES))]
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        issuer = _authority(folder)
        server = _issue(issuer, "edge-service", days, alternatives)
        written = [_write(folder, SERVER, *server)]
        for client, common_name in clients.items():
            written.append(_write(folder, client, *_issue(issuer, common_name, days)))
    except OSError as error:
        raise CertificateError(f"{folder}: {error.strerror}") from None
    return (folder / f"{AUTHORITY}.pem", *written)


def expiry(path: Path) -> datetime:
    """End of a certificate. Raises CertificateError."""
    try:
        return x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
    except OSError as error:
        raise CertificateError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise CertificateError(f"{path}: contains no certificate") from None


def _alternative(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        pass
    labels = name.removeprefix("*.").split(".")
    if not all(label.isascii() and label.replace("-", "").isalnum() for label in labels):
        raise CertificateError(f"{name!r} is no host name and no address")
    return x509.DNSName(name)


def _authority(folder: Path) -> _Issuer:
    """The authority of the folder, made if there is none."""
    certificate, key = folder / f"{AUTHORITY}.pem", folder / f"{AUTHORITY}.key"
    if not certificate.exists() and not key.exists():
        issuer = _new_authority()
        _write(folder, AUTHORITY, issuer.certificate, issuer.key)
        return issuer
    try:
        signer = serialization.load_pem_private_key(key.read_bytes(), None)
        known = x509.load_pem_x509_certificate(certificate.read_bytes())
    except ValueError:
        raise CertificateError(f"{folder}: {AUTHORITY}.pem or .key is damaged") from None
    if not isinstance(signer, ec.EllipticCurvePrivateKey):
        raise CertificateError(f"{key}: expected the key that `edge-service certs` has made")
    return _Issuer(known, signer)


def _new_authority() -> _Issuer:
    key = ec.generate_private_key(ec.SECP256R1())
    stamp = datetime.now(UTC).strftime("%Y-%m-%d")
    name = _name(f"edge-service authority of {stamp}")
    usage = _usage(signs_certificates=True)
    certificate = (
        _builder(name, name, key.public_key(), AUTHORITY_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    return _Issuer(certificate, key)


def _issue(
    issuer: _Issuer, common_name: str, days: int, alternatives: Sequence[x509.GeneralName] = ()
) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    """A certificate of a server (with `alternatives`) or of a client, and its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    server = bool(alternatives)
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH
    named = alternatives or [x509.DNSName(common_name)]
    signer = x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer.key.public_key())
    subject = issuer.certificate.subject
    certificate = (
        _builder(_name(common_name), subject, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.SubjectAlternativeName(named), critical=False)
        .add_extension(signer, critical=False)
        .sign(issuer.key, hashes.SHA256())
    )
    return certificate, key


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _EARLIER)
        .not_valid_after(now + timedelta(days=days))
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        encipher_only=False,
        decipher_only=False,
    )


def _write(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey
) -> Path:
    """Write `name.key` for its owner alone, then `name.pem`; returns the latter's path."""
    pem, plain = serialization.Encoding.PEM, serialization.NoEncryption()
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, plain)
    with replaced_file(folder / f"{name}.key", PRIVATE) as file:
        file.write(secret.decode("ascii"))
    path = folder / f"{name}.pem"
    with replaced_file(path) as file:
        file.write(certificate.public_bytes(pem).decode("ascii"))
    return path
