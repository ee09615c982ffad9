"""An authority for the tests and what it issues, and pairs that sign themselves for OPC UA."""

import socket
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from pathlib import Path

import trustme
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID


def write_certificates(folder: Path, *names: str) -> tuple[Path, Path]:
    """Write `ca.pem`, `server.pem` and `server.key`; returns the last two.

    Args:
        names: host names and addresses of the server, besides those of loopback.
    """
    authority = trustme.CA()
    issued = authority.issue_cert("localhost", "127.0.0.1", "::1", *names)
    authority.cert_pem.write_to_path(folder / "ca.pem")
    certificate, key = folder / "server.pem", folder / "server.key"
    issued.private_key_pem.write_to_path(key)
    key.chmod(0o600)
    for part in issued.cert_chain_pems:
        part.write_to_path(certificate, append=True)
    return certificate, key


def write_pair(folder: Path, name: str, uri: str | None) -> tuple[Path, Path]:
    """Write `NAME.pem`, which signs itself, and `NAME.key.pem`; without a URI it is not whole."""
    key, now = rsa.generate_private_key(65537, 2048), datetime.now(UTC)
    who = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    builder = x509.CertificateBuilder(who, who, key.public_key(), x509.random_serial_number())
    builder = builder.not_valid_before(now - timedelta(1)).not_valid_after(now + timedelta(9))
    if uri is not None:
        names = [x509.UniformResourceIdentifier(uri), x509.DNSName(socket.gethostname())]
        names += [x509.IPAddress(ip_address("127.0.0.1"))]
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        usage = x509.KeyUsage(True, True, True, True, False, True, False, False, False)
        for extension in (x509.SubjectAlternativeName(names), usage, x509.ExtendedKeyUsage(uses)):
            builder = builder.add_extension(extension, critical=False)
        builder = builder.add_extension(x509.BasicConstraints(True, 0), critical=True)
    certificate, private = folder / f"{name}.pem", folder / f"{name}.key.pem"
    pem, pkcs8 = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
    certificate.write_bytes(builder.sign(key, hashes.SHA256()).public_bytes(pem))
    private.write_bytes(key.private_bytes(pem, pkcs8, serialization.NoEncryption()))
    private.chmod(0o600)
    return certificate, private
