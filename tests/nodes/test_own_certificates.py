"""Tests of the certificates that nodes make for themselves."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from edge_service.bus.access import PUTS
from edge_service.config import AxisConfig, BusConfig, EdgeConfig, HistoryConfig
from edge_service.nodes.wiring.bus_rights import node_settings
from edge_service.nodes.wiring.own_certificates import own_certificates


def config_of(folder: Path | None) -> EdgeConfig:
    """A configuration that keeps its history in a folder."""
    return EdgeConfig(history=HistoryConfig(folder=folder), axes=(AxisConfig(name="X"),))


def test_nodes_that_start_at_once_make_one_authority(tmp_path: Path) -> None:
    config = config_of(tmp_path / "history")
    with ThreadPoolExecutor(4) as pool:
        folders = set(pool.map(lambda _: own_certificates(config), range(8)))
    (folder,) = folders
    content = (folder / "ca.pem").read_bytes()
    assert own_certificates(config) == folder
    assert (folder / "ca.pem").read_bytes() == content


def test_nobody_else_may_read_their_keys(tmp_path: Path) -> None:
    folder = own_certificates(config_of(tmp_path))
    assert folder.stat().st_mode & 0o077 == 0
    keys = list(folder.glob("*.key"))
    assert len(keys) == len(PUTS) + 2
    assert all(key.stat().st_mode & 0o077 == 0 for key in keys)


def test_without_a_history_they_are_the_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert own_certificates(config_of(None)).is_relative_to(tmp_path)
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert own_certificates(config_of(None)).is_relative_to(tmp_path / "home")


@pytest.mark.parametrize("name", ["bus", *PUTS])
def test_every_node_takes_part_with_them_at_the_next_port(name: str, tmp_path: Path) -> None:
    settings = node_settings(config_of(tmp_path), name)
    assert settings.security == "readers"
    assert settings.tls is not None
    assert settings.tls.endpoint == "tls/127.0.0.1:7448"


def test_a_stated_endpoint_stays(tmp_path: Path) -> None:
    bus = BusConfig(tls_endpoint="tls/127.0.0.1:9000")
    config = config_of(tmp_path).model_copy(update={"bus": bus})
    settings = node_settings(config, "acquire")
    assert settings.tls is not None
    assert settings.tls.endpoint == "tls/127.0.0.1:9000"
