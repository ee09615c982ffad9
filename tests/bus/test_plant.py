"""Sessions and routers of a plant: wrong settings are told, a lost router is found again."""

import asyncio
import socket
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from edge_service.bus.plant.router import open_router
from edge_service.bus.plant.session import (
    PlantAwayError,
    PlantSession,
    PlantSettings,
    PlantSettingsError,
)
from edge_service.bus.settings import TlsSettings
from edge_service.certificates import make_certificates

KEY = "feeddrive/plant/v1/test"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


async def until(done: Callable[[], bool]) -> None:
    async with asyncio.timeout(20.0):
        while not done():
            await asyncio.sleep(0.01)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    make_certificates(folder, (), {"plant": "plant.node.edge-service"}, 1)
    return folder


def of_folder(folder: Path, name: str) -> TlsSettings:
    return TlsSettings.of_folder("", folder, name)


@pytest.mark.parametrize(
    ("endpoint", "said"),
    [
        ("nonsense", "is not an endpoint"),
        ("udp/127.0.0.1:7447", "is not an endpoint"),
        ("tcp/127.0.0.1:0", "is not an endpoint"),
        ("tcp/127.0.0.1:70000", "is not an endpoint"),
        ("tcp/127.0.0.1:7447#iface=lo", "is not an endpoint"),
        ("tcp/192.0.2.1:7447", "leaves this machine unencrypted"),
        ("tcp/router.plant:7447", "leaves this machine unencrypted"),
        ("tls/192.0.2.1:7447", "needs ca_certificate"),
    ],
)
def test_an_endpoint_that_cannot_be_meant_is_refused(endpoint: str, said: str) -> None:
    with pytest.raises(PlantSettingsError, match=said):
        PlantSettings(endpoint)
    with pytest.raises(PlantSettingsError, match=said):
        open_router([endpoint])


def test_plain_tcp_leaves_the_machine_where_it_is_allowed() -> None:
    assert PlantSettings("tcp/192.0.2.1:7447", allow_plain=True).certificates is None


async def test_no_router_is_an_error_that_may_pass_and_a_missing_file_one_that_stays(
    folder: Path,
) -> None:
    with pytest.raises(PlantAwayError, match="no router answers"):
        await PlantSession.open(PlantSettings(f"tcp/127.0.0.1:{free_port()}"))
    missing = TlsSettings("", folder / "ca.pem", folder / "other.pem", folder / "other.key")
    with pytest.raises(PlantSettingsError, match=r"other\.pem: No such file"):
        await PlantSession.open(PlantSettings("tls/127.0.0.1:7447", missing))


async def test_a_port_in_use_is_told() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(PlantSettingsError, match="in use"):
            open_router([f"tcp/127.0.0.1:{taken.getsockname()[1]}"])


async def test_a_session_finds_its_router_again() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = open_router([endpoint])
    session = await PlantSession.open(PlantSettings(endpoint))
    assert session.is_connected
    router.close()
    await until(lambda: not session.is_connected)
    router = open_router([endpoint])
    await until(lambda: session.is_connected)
    await session.close()
    await session.close()
    assert not session.is_connected
    router.close()


async def passed_on(writer: zenoh.Session, reader: zenoh.Session) -> None:
    """Wait until what one puts has reached the other."""
    heard: list[bytes] = []
    with reader.declare_subscriber(KEY, lambda sample: heard.append(sample.payload.to_bytes())):
        async with asyncio.timeout(20.0):
            while not heard:
                writer.put(KEY, b"there")
                await asyncio.sleep(0.01)
    assert heard[0] == b"there"


async def test_what_is_put_at_one_router_is_heard_at_the_one_above(folder: Path) -> None:
    """Each link is encrypted, with the authority's certificates on both sides."""
    server, client = of_folder(folder, "server"), of_folder(folder, "plant")
    above, below = (f"tls/127.0.0.1:{free_port()}" for _ in range(2))
    edge = open_router([below], [above], server, client)  # the one above it comes later
    plant = open_router([above], [], server)
    writer = await PlantSession.open(PlantSettings(below, client))
    reader = await PlantSession.open(PlantSettings(above, client))
    await passed_on(writer.zenoh, reader.zenoh)
    for session in (writer, reader):
        await session.close()
    for router in (edge, plant):
        router.close()


async def test_a_certificate_of_another_authority_is_not_let_in(
    folder: Path, tmp_path: Path
) -> None:
    make_certificates(tmp_path, (), {"plant": "plant.node.edge-service"}, 1)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    router = open_router([endpoint], [], of_folder(folder, "server"))
    with pytest.raises(PlantAwayError, match="trusts this certificate"):
        await PlantSession.open(PlantSettings(endpoint, of_folder(tmp_path, "plant")))
    router.close()
