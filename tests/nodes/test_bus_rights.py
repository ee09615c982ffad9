"""How processes take part in the bus, by what the configuration says."""

import pytest

from edge_service.config import BusConfig, ConfigError
from edge_service.nodes.wiring.bus_rights import node_settings, reader_settings, router_settings

from .conftest import config_of


@pytest.mark.parametrize("security", ["readers", "open"])
def test_without_certificates_nodes_take_part_in_an_open_bus_alone(security: str) -> None:
    config = config_of("simulated", {}, bus=BusConfig(security=security))
    assert router_settings(config).security == security
    assert reader_settings(config).tls is None
    for name in ("bus", "estimate"):
        if security == "open":
            assert node_settings(config, name).tls is None
        else:
            with pytest.raises(ConfigError, match="edge-service certs"):
                node_settings(config, name)
