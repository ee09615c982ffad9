"""The service as an adapter of MTConnect: a foreign agent reads the condition of the page."""

from pathlib import Path

import httpx
import pytest
from click.testing import CliRunner

from edge_service.cli.entry import cli
from edge_service.config import ConfigError, load_config

from ..bus.mtconnect.agent import Agent, connected, item_types
from ..drivers.bench import free_port
from .conftest import PIPELINE, running, until

AXES = '[[axes]]\nname = "X"\n[[axes]]\nname = "Y"\n'
PLACES = '[bus]\nendpoint = "tcp/127.0.0.1:0"\n[http]\nport = 0\n'


def configured(folder: Path, mtconnect: str) -> Path:
    path = folder / "edge.toml"
    path.write_text(f"{PLACES}[mtconnect]\n{mtconnect}\n{AXES}")
    path.chmod(0o600)
    return path


@pytest.mark.parametrize(
    ("mtconnect", "complaint"),
    [
        ('host = "192.168.1.2"', "mtconnect: '192.168.1.2' is not a loopback address"),
        ("clients = 0", "mtconnect.clients: "),
        ("ports = 1", "mtconnect.ports: unknown key"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(mtconnect: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]*$") as caught:
        load_config(configured(tmp_path, mtconnect))
    assert complaint in str(caught.value)


def test_whoever_says_so_may_listen_anywhere(tmp_path: Path) -> None:
    path = configured(tmp_path, 'host = "0.0.0.0"\nallow_plain = true')
    settings = load_config(path).mtconnect
    assert settings is not None and settings.host == "0.0.0.0"


def devices(path: Path) -> str:
    out = path.with_name("Devices.xml")
    done = CliRunner().invoke(cli, ["mtconnect-devices", str(path), "--out", str(out)])
    assert done.output == f"{out}: axes X, Y\n"
    return out.read_text()


async def test_the_condition_is_that_of_the_page(tmp_path: Path) -> None:
    port = free_port()
    path = configured(tmp_path, f"port = {port}")
    described = devices(path)
    assert {"condition_X", "condition_Y", "avail"} <= item_types(described).keys()
    async with running(load_config(path), ("mtconnect", *PIPELINE)) as service:
        address = await service.address

        async def there() -> bool:
            async with httpx.AsyncClient(base_url=address) as page:
                parts = (await page.get("/api/v1/health")).json()["components"]
            return any(
                each["component"] == "mtconnect" and each["status"] == "ok" for each in parts
            )

        await until(there)
        async with (
            connected(port, described) as agent,
            httpx.AsyncClient(base_url=address) as page,
        ):

            async def agrees() -> bool:
                return all([await _agrees(agent, page, axis) for axis in "XY"])

            await until(agrees)


async def _agrees(agent: Agent, page: httpx.AsyncClient, axis: str) -> bool:
    """Tell whether an axis is known, and the same to both."""
    said = (await page.get(f"/api/v1/axes/{axis}/health")).json()
    if said["condition"] == "UNAVAILABLE" or f"condition_{axis}" not in agent.conditions:
        return False
    alarms = {alarm["kind"] for alarm in said["alarms"] if alarm["active"]}
    told = set(agent.conditions[f"alarms_{axis}"]) - {""}
    return agent.level(f"condition_{axis}") == said["condition"] and told == alarms
