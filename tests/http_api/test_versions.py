"""The service tells which program and which configuration it runs."""

import httpx
import pytest

from edge_service import __version__
from edge_service.health.service_state import ServiceState
from edge_service.health.state_settings import Running
from edge_service.http_api.app import create_app

RUNNING = Running("37ef462efa36", 7)


async def answered(running: Running | None, path: str) -> httpx.Response:
    app = create_app(ServiceState({"X": None}, 0, running=running), lambda: 0)
    transport = httpx.ASGITransport(app)
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as client:
        return await client.get(path)


@pytest.mark.parametrize(
    ("running", "configuration", "bundle"),
    [
        (RUNNING, "37ef462efa36", 7),
        (Running("37ef462efa36"), "37ef462efa36", None),
        (None, "", None),
    ],
)
async def test_health_tells_version_digest_and_bundle(
    running: Running | None, configuration: str, bundle: int | None
) -> None:
    told = (await answered(running, "/api/v1/health")).json()
    assert told["version"] == __version__
    assert (told["configuration"], told["bundle"]) == (configuration, bundle)


async def test_the_metric_has_them_as_labels() -> None:
    text = (await answered(RUNNING, "/metrics")).text
    labels = f'bundle="7",configuration="37ef462efa36",version="{__version__}"'
    assert f"edge_service_build_info{{{labels}}} 1.0" in text.splitlines()
