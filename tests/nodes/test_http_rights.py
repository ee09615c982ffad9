"""Certificate and tokens of the configuration are checked before anything is served."""

from pathlib import Path
from typing import Any

import pytest
import trustme

from edge_service.config import ConfigError, HttpConfig
from edge_service.config_tables import StoreConfig
from edge_service.nodes.http_rights import check_access, server_files, tokens_of
from tests.certificates import write_certificates

from .conftest import config_of, served, until


def configured(folder: Path, **http: Any) -> Any:
    store = StoreConfig(folder=folder / "state")
    return config_of("simulated", {}, http=HttpConfig(port=0, **http), store=store)


def test_loopback_needs_nothing_until_a_token_exists(tmp_path: Path) -> None:
    config = configured(tmp_path)
    assert check_access(config) == "no TLS, for any user of this machine"
    tokens_of(config).add("kim", "viewer", 0)
    assert check_access(config) == "no TLS, for whoever has one of 1 tokens"


def test_beyond_loopback_and_behind_a_proxy_a_token_is_needed(tmp_path: Path) -> None:
    certificate, key = write_certificates(tmp_path)
    public = {"host": "192.0.2.1", "certificate": certificate, "private_key": key}
    for http, place in ((public, "host"), ({"url": "https://mill7.plant/"}, "url")):
        config = configured(tmp_path / place, **http)
        with pytest.raises(ConfigError, match=rf"http\.{place}: .* edge-service token CONFIG"):
            check_access(config)
        tokens_of(config).add("kim", "operator", 0)
        assert check_access(config).endswith("for whoever has one of 1 tokens")


def test_certificate_and_key_must_fit_and_others_read_no_key(tmp_path: Path) -> None:
    certificate, key = write_certificates(tmp_path)
    http = HttpConfig(certificate=certificate, private_key=key)
    assert server_files(http) == (certificate, key)
    key.chmod(0o604)
    with pytest.raises(ConfigError, match=r"http\.private_key: .* others may read"):
        server_files(http)
    other = trustme.CA().issue_cert("localhost")
    other.private_key_pem.write_to_path(key)
    key.chmod(0o600)
    with pytest.raises(ConfigError, match=r"http\.certificate: .* KEY_VALUES_MISMATCH"):
        server_files(http)


async def test_a_token_that_is_added_beside_the_running_service_counts_at_once(
    tmp_path: Path,
) -> None:
    config = configured(tmp_path)
    async with served(config, ("http",)) as (_, client):
        assert (await client.get("api/v1/axes")).status_code == 200
        secret = tokens_of(config).add("kim", "operator", 0)

        async def is_closed() -> bool:
            return (await client.get("api/v1/axes")).status_code == 401

        await until(is_closed)
        client.headers["authorization"] = f"Bearer {secret}"
        made = await client.post("api/v1/tokens", json={"name": "jo", "role": "viewer"})
        assert made.status_code == 201

        async def told() -> list[str]:
            items = (await client.get("api/v1/log?kind=command")).json()["items"]
            return [each["text"] for each in items]

        assert await until(told) == ["kim (127.0.0.1): POST /api/v1/tokens"]
