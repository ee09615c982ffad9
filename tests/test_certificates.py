"""The local authority: what it signs is accepted by OpenSSL, and secrets are for their owner."""

import ssl
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from edge_service.certificates import CertificateError, expiry, make_certificates

CLIENTS = {"acquire": "acquire.node"}


def loaded(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_every_file_is_there_and_keys_are_for_their_owner(tmp_path: Path) -> None:
    folder = tmp_path / "new"
    written = make_certificates(folder, ["edge-box"], CLIENTS, 30)
    assert [path.name for path in written] == ["ca.pem", "server.pem", "acquire.pem"]
    for path in written:
        assert path.with_suffix(".key").stat().st_mode & 0o777 == 0o600
    assert len(list(folder.iterdir())) == 6


def test_the_server_has_its_names_and_those_of_loopback(tmp_path: Path) -> None:
    make_certificates(tmp_path, ["edge-box", "192.168.1.5", "edge-box"], {}, 30)
    names = loaded(tmp_path / "server.pem").extensions.get_extension_for_class(
        x509.SubjectAlternativeName
    )
    hosts = names.value.get_values_for_type(x509.DNSName)
    addresses = [str(each) for each in names.value.get_values_for_type(x509.IPAddress)]
    assert hosts == ["edge-box", "localhost"]
    assert addresses == ["192.168.1.5", "127.0.0.1", "::1"]


@pytest.mark.parametrize(
    ("name", "purpose"),
    [("server", ExtendedKeyUsageOID.SERVER_AUTH), ("acquire", ExtendedKeyUsageOID.CLIENT_AUTH)],
)
def test_a_certificate_serves_one_purpose(
    name: str, purpose: x509.ObjectIdentifier, tmp_path: Path
):
    make_certificates(tmp_path, (), CLIENTS, 30)
    usage = loaded(tmp_path / f"{name}.pem").extensions.get_extension_for_class(
        x509.ExtendedKeyUsage
    )
    assert list(usage.value) == [purpose]


def test_the_common_name_of_a_client_is_the_one_asked_for(tmp_path: Path) -> None:
    make_certificates(tmp_path, (), CLIENTS, 30)
    subject = loaded(tmp_path / "acquire.pem").subject
    assert [each.value for each in subject.get_attributes_for_oid(NameOID.COMMON_NAME)] == [
        "acquire.node"
    ]


def test_the_authority_is_used_again_and_the_rest_made_anew(tmp_path: Path) -> None:
    make_certificates(tmp_path, (), CLIENTS, 30)
    old = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    make_certificates(tmp_path, (), CLIENTS, 30)
    same = {path.name for path in tmp_path.iterdir() if path.read_bytes() == old[path.name]}
    assert same == {"ca.pem", "ca.key"}


def test_they_hold_as_long_as_asked_for(tmp_path: Path) -> None:
    make_certificates(tmp_path, (), {}, 30)
    rest = expiry(tmp_path / "server.pem") - datetime.now(UTC)
    assert timedelta(days=29) < rest <= timedelta(days=30)


def handshake(client: ssl.SSLContext, server: ssl.SSLContext, name: str) -> None:
    """Both sides of a handshake in memory; ssl.SSLError if one refuses."""
    there, back = ssl.MemoryBIO(), ssl.MemoryBIO()
    sides = [
        client.wrap_bio(back, there, server_hostname=name),
        server.wrap_bio(there, back, server_side=True),
    ]
    for _ in range(4):
        for side in sides:
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue


@pytest.mark.parametrize("name", ["edge-box", "127.0.0.1", "::1", "localhost", "192.168.1.5"])
def test_openssl_accepts_both_sides_at_its_strictest(name: str, tmp_path: Path) -> None:
    make_certificates(tmp_path, ["edge-box", "192.168.1.5"], CLIENTS, 30)
    client = ssl.create_default_context(cafile=str(tmp_path / "ca.pem"))
    client.verify_flags |= ssl.VERIFY_X509_STRICT
    client.load_cert_chain(tmp_path / "acquire.pem", tmp_path / "acquire.key")
    server = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH, cafile=str(tmp_path / "ca.pem"))
    server.verify_mode = ssl.CERT_REQUIRED
    server.load_cert_chain(tmp_path / "server.pem", tmp_path / "server.key")
    handshake(client, server, name)
    with pytest.raises(ssl.SSLError, match="match"):
        handshake(client, server, "elsewhere")


@pytest.mark.parametrize("name", ["", "a b", "a..b", "http://x", "größe", "x:1", "\n"])
def test_a_name_that_is_none_is_refused_before_anything_is_written(
    name: str, tmp_path: Path
) -> None:
    with pytest.raises(CertificateError, match="is no host name"):
        make_certificates(tmp_path / "new", [name], {}, 30)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["ca.pem", "ca.key"])
@pytest.mark.parametrize("content", [None, b"", b"-----BEGIN CERTIFICATE-----", bytes(100)])
def test_a_damaged_or_lost_authority_is_named(
    name: str, content: bytes | None, tmp_path: Path
) -> None:
    make_certificates(tmp_path, (), {}, 30)
    path = tmp_path / name
    path.unlink() if content is None else path.write_bytes(content)
    with pytest.raises(CertificateError, match=str(tmp_path)):
        make_certificates(tmp_path, (), {}, 30)


def test_a_file_without_a_certificate_is_named(tmp_path: Path) -> None:
    for name, content in (("none.pem", None), ("key.pem", b"x")):
        if content:
            (tmp_path / name).write_bytes(content)
        with pytest.raises(CertificateError, match=name):
            expiry(tmp_path / name)
