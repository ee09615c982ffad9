"""Certificates and tokens of the configuration are checked before anything is served."""

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives import serialization

from edge_service.certificates import make_certificates
from edge_service.config import BusConfig, ConfigError, HttpConfig
from edge_service.http_api.security.tokens import add_token
from edge_service.nodes.wiring.bus_rights import router_settings
from edge_service.nodes.wiring.http_rights import (
    certificate_readings,
    check_access,
    doorkeeper_of,
    hosts_of,
    tls_files,
)

from .conftest import config_of


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
    assert (
        check_access(HttpConfig()) == "no TLS, no tokens: anyone who can reach it may do anything"
    )


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


@pytest.mark.parametrize(("left", "told"), [(-400.0, True), (29.0, True), (31.0, False)])
def test_a_certificate_that_ends_is_told_and_stops_nothing(
    left: float, told: bool, folder: Path, monkeypatch: Any, caplog: Any
) -> None:
    end = datetime.now(UTC) + timedelta(days=left)
    monkeypatch.setattr("edge_service.certificates.expiry", lambda _path: end)
    assert str(end.year) in check_access(http_of(folder))
    readings = certificate_readings(http_of(folder))
    assert readings()["certificate_days"] == pytest.approx(left, abs=0.01)
    assert ("run `edge-service certs` again" in caplog.text) == told
    caplog.clear()
    router_settings(config_of("simulated", {}, bus=BusConfig(certificates=folder)))
    assert ("run `edge-service certs` again" in caplog.text) == told


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o666])
def test_a_key_that_others_may_read_is_refused(mode: int, folder: Path) -> None:
    path = folder / "server.key"
    path.chmod(mode)
    refused = [lambda: tls_files(http_of(folder))]
    refused += [
        lambda: router_settings(config_of("simulated", {}, bus=BusConfig(certificates=folder)))
    ]
    if mode != 0o640 or os.geteuid() != 0:  # what root owns its group may read
        for each in refused:
            with pytest.raises(ConfigError, match="others may read"):
                each()


def test_a_key_may_be_a_credential_of_systemd(folder: Path, monkeypatch: Any) -> None:
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(folder))
    key = Path("$CREDENTIALS_DIRECTORY/server.key")
    http = http_of(folder).model_copy(update={"private_key": key})
    assert tls_files(http) == (folder / "server.pem", folder / "server.key")
