"""Certificates and tokens of the configuration are checked before anything is served."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from cryptography.hazmat.primitives import serialization

from edge_service.certificates import make_certificates
from edge_service.config import ConfigError, HttpConfig
from edge_service.http_api.security.tokens import add_token
from edge_service.nodes.wiring.http_rights import check_access, doorkeeper_of, hosts_of, tls_files


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_certificates(tmp_path, ["box"], {"other": "other"}, 10)
    add_token(tmp_path / "tokens.json", "kim", "admin", 1, datetime.now(UTC))
    return tmp_path


def http_of(folder: Path, certificate: str = "server.pem", key: str = "server.key") -> HttpConfig:
    return HttpConfig(
        host="192.0.2.1",
        certificate=folder / certificate,
        private_key=folder / key,
        tokens_file=folder / "tokens.json",
        allowed_hosts=("box",),
    )


def test_a_public_address_with_tls_and_tokens_is_right(folder: Path) -> None:
    http = http_of(folder)
    said = check_access(http)
    assert said.startswith("TLS until 20")
    assert said.endswith("tokens in " + str(folder / "tokens.json"))
    assert tls_files(http) == (folder / "server.pem", folder / "server.key")
    assert doorkeeper_of(http).tokens is not None


def test_loopback_needs_nothing() -> None:
    assert check_access(HttpConfig()) == "no TLS, whoever reaches it may do anything"


@pytest.mark.parametrize(
    ("host", "own"),
    [("192.0.2.1", "192.0.2.1"), ("::", None), ("0.0.0.0", None), ("fd00::1", "[fd00::1]")],
)
def test_it_answers_to_its_address_and_to_the_names_it_is_given(
    host: str, own: str | None, folder: Path
) -> None:
    hosts = hosts_of(http_of(folder).model_copy(update={"host": host}))
    expected = {"127.0.0.1", "localhost", "[::1]", "box", own} - {None}
    assert set(hosts) == expected


def test_certificate_and_key_must_fit(folder: Path) -> None:
    with pytest.raises(ConfigError, match="KEY_VALUES_MISMATCH"):
        tls_files(http_of(folder, key="other.key"))


def test_a_key_with_a_password_is_refused_and_nobody_is_asked_for_it(folder: Path) -> None:
    path = folder / "server.key"
    key = serialization.load_pem_private_key(path.read_bytes(), None)
    path.write_bytes(
        key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.BestAvailableEncryption(b"secret"),
        )
    )
    with pytest.raises(ConfigError, match=r"http\.certificate"):
        tls_files(http_of(folder))


def test_a_certificate_that_has_ended_is_refused(folder: Path, monkeypatch) -> None:
    ended = datetime(2020, 1, 1, tzinfo=UTC)
    monkeypatch.setattr("edge_service.nodes.wiring.http_rights.expiry", lambda _path: ended)
    with pytest.raises(ConfigError, match="ended on 2020-01-01"):
        check_access(http_of(folder))
