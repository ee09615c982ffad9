"""TLS from the first byte on: who does not shake hands is let go, and holds up no other."""

import asyncio
import ssl
from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from edge_service.certificates import make_certificates
from edge_service.http_api.limits.connections import Connections
from edge_service.http_api.limits.descriptors import open_descriptors
from edge_service.http_api.limits.handshakes import HandshakeListener
from edge_service.http_api.limits.settings import HttpLimits
from edge_service.http_api.serve import bind
from tests.http_api.raw_clients import HOST, connected, served

SOON = 0.1
ALIVE = b"GET /healthz HTTP/1.1\r\nconnection: close\r\n" + HOST + b"\r\n"


@pytest.fixture
def tls(tmp_path: Path) -> tuple[Path, Path]:
    make_certificates(tmp_path, (), {}, 1)
    return tmp_path / "server.pem", tmp_path / "server.key"


@pytest.fixture
def trusting(tls: tuple[Path, Path]) -> ssl.SSLContext:
    return ssl.create_default_context(cafile=str(tls[0].with_name("ca.pem")))


async def alive(port: int, context: ssl.SSLContext) -> bytes:
    reader, writer = await asyncio.open_connection("127.0.0.1", port, ssl=context)
    writer.write(ALIVE)
    try:
        return await asyncio.wait_for(reader.read(), 5.0)
    finally:
        writer.close()


async def test_tls_is_served_to_who_trusts_the_authority(scene, tls, trusting):
    async with served(scene, HttpLimits(), tls=tls) as port:
        assert (await alive(port, trusting))[9:12] == b"200"
        with pytest.raises(ssl.SSLCertVerificationError):
            await alive(port, ssl.create_default_context())


@pytest.mark.parametrize("version", [ssl.TLSVersion.TLSv1_2, ssl.TLSVersion.TLSv1_3])
async def test_versions_of_tls_that_are_good_are_taken(scene, tls, trusting, version):
    trusting.minimum_version = trusting.maximum_version = version
    async with served(scene, HttpLimits(), tls=tls) as port:
        assert (await alive(port, trusting))[9:12] == b"200"


async def test_plain_http_and_old_tls_get_nothing(scene, tls):
    hello = (
        bytes.fromhex("16030100310100002d0301")
        + bytes(32)
        + bytes.fromhex("000006c013c014000a0100")
    )
    async with served(scene, HttpLimits(), tls=tls) as port:
        for sent in (ALIVE, hello):
            async with connected(port) as client:
                client.send(sent)
                assert b"HTTP" not in await client.answer()


async def test_handshakes_that_stop_are_let_go(scene, tls):
    limits = HttpLimits(head_s=SOON)
    async with served(scene, limits, tls=tls) as port:
        for sent in (b"", b"\x16", b"\x16\x03\x01\x02\x00\x01"):
            async with connected(port) as client:
                client.send(sent)
                assert b"HTTP" not in await client.answer()


async def test_a_crowd_that_never_shakes_hands_takes_few_descriptors(scene, tls, trusting):
    limits = HttpLimits(handshakes=4, head_s=SOON)
    async with served(scene, limits, tls=tls) as port, AsyncExitStack() as crowd:
        before = open_descriptors()
        for _ in range(40):
            await crowd.enter_async_context(connected(port))
        await asyncio.sleep(0)
        assert open_descriptors() - before <= 40 + limits.handshakes
        async with asyncio.timeout(5.0):
            while True:
                try:
                    answer = await alive(port, trusting)
                except OSError:  # all handshakes are taken, for now
                    continue
                if answer[9:12] == b"200":
                    break


def test_an_address_has_a_part_of_the_handshakes(monkeypatch):
    limits = HttpLimits(handshakes=6, handshakes_of_one=2)
    peers = iter([*["192.0.2.1"] * 3, *["127.0.0.1"] * 3, *["192.0.2.2"] * 3])

    class _Socket:
        def fileno(self) -> int:
            return 1

        def close(self) -> None:
            """Nothing to close."""

    with HandshakeListener(bind("127.0.0.1", 0), limits, Connections(9, 9)) as listener:
        monkeypatch.setattr("socket.socket.accept", lambda _: (_Socket(), (next(peers), 1)))
        taken = []
        for _ in range(9):
            try:
                taken.append(listener.accept()[1][0])
            except BlockingIOError:
                continue
    assert taken == ["192.0.2.1"] * 2 + ["127.0.0.1"] * 3 + ["192.0.2.2"]
