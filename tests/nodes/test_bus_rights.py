"""How processes take part in the bus, by what the configuration says."""

from pathlib import Path

import pytest

from edge_service.config import BusConfig, HistoryConfig
from edge_service.nodes.wiring.bus_rights import node_settings, reader_settings, router_settings

from .conftest import config_of


@pytest.mark.parametrize("security", ["readers", "open"])
def test_without_certificates_nodes_make_their_own_unless_the_bus_is_open(
    security: str, tmp_path: Path
) -> None:
    history = HistoryConfig(folder=tmp_path)
    config = config_of("simulated", {}, bus=BusConfig(security=security), history=history)
    assert router_settings(config).security == security
    assert reader_settings(config).tls is None
    for name in ("bus", "estimate"):
        assert (node_settings(config, name).tls is None) == (security == "open")
    assert any(tmp_path.iterdir()) == (security != "open")
