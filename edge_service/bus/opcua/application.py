"""Settings of the server, and its name, which its certificate must hold as well."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric.rsa import RSAPublicKey

URI = "urn:edge-service"


class OpcuaError(Exception):
    """Settings that cannot work; the text is one line."""


@dataclass(frozen=True, slots=True)
class OpcuaSettings:
    """Settings of the server.

    Attributes:
        host, port: where it listens; port 0 takes a free one.
        machine: name of the machine, for people.
        certificate, key: files in PEM; encrypted with them, and only then.
        knows: tells whether a user's name and password fit; None lets anybody look.
        sessions: how many there may be at once.
    """

    host: str
    port: int
    machine: str
    certificate: Path | None = None
    key: Path | None = None
    knows: Callable[[str, str], bool] | None = None
    sessions: int = 20


def application_uri(certificate: Path | None) -> str:
    """Name that the certificate holds; the usual one without. Raises OpcuaError."""
    if certificate is None:
        return URI
    try:
        held = x509.load_pem_x509_certificate(certificate.read_bytes())
        names = held.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = names.get_values_for_type(x509.UniformResourceIdentifier)
    except OSError as error:
        raise OpcuaError(f"{certificate}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise OpcuaError(f"{certificate}: contains no certificate") from None
    except x509.ExtensionNotFound:
        uris = []
    if not uris or not isinstance(held.public_key(), RSAPublicKey):
        raise OpcuaError(
            f"{certificate}: OPC UA needs an RSA key and in subjectAltName a URI, such as {URI}"
        )
    return str(uris[0])
