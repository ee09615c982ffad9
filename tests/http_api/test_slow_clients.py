"""Clients that are slow, silent or too many: each is told and let go, and holds up no other."""

import asyncio
import socket
from contextlib import AsyncExitStack

import pytest

from edge_service.http_api.limits.connections import Connections
from edge_service.http_api.limits.descriptors import affordable_connections
from edge_service.http_api.limits.settings import HttpLimits

from .raw_clients import HOST, connected, served

SOON = 0.05
ALIVE = b"GET /healthz HTTP/1.1\r\n" + HOST + b"\r\n"
STREAM = b"GET /api/v1/events HTTP/1.1\r\n" + HOST + b"\r\n"
POST = b"POST /api/v1/axes/X/commands HTTP/1.1\r\ncontent-type: application/json\r\n" + HOST


@pytest.mark.parametrize(
    ("sent", "status"),
    [
        (b"", b""),
        (b"GET /healthz", b"408"),
        (b"GET /healthz HTTP/1.1\r\n" + HOST, b"408"),
        (POST + b"Content-Length: 10\r\n\r\n{", b"408"),
        (POST + b"Transfer-Encoding: chunked\r\n\r\n1\r\n{\r\n", b"408"),
        (ALIVE[:-2] + b"Content-Length: 10\r\n\r\n", b"408"),
        (b"GET /" + b"a" * 3000, b"400"),
        (b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 1000, b"400"),
        (b"\x16\x03\x01" + b"\0" * 100 + b"\r\n\r\n", b"400"),
    ],
)
async def test_who_does_not_go_on_is_told_and_let_go(scene, sent, status):
    limits = HttpLimits(head_s=SOON, body_idle_s=SOON, linger_s=SOON, head_bytes=2000)
    async with served(scene, limits) as port, connected(port) as client:
        client.send(sent)
        answer = await client.answer()
    assert answer[9:12] == status
    assert (b"application/problem+json" in answer) == (status in (b"400", b"408"))


async def test_bytes_that_trickle_do_not_extend_the_time_of_a_head(scene):
    limits = HttpLimits(head_s=SOON)
    async with served(scene, limits) as port, connected(port) as client:
        client.send(b"GET /healthz HTTP/1.1\r\n")

        async def trickle() -> None:
            while True:
                client.send(b"a:b\r\n")
                await asyncio.sleep(SOON / 10)

        trickling = asyncio.create_task(trickle())
        answer = await client.answer()
        trickling.cancel()
    assert answer[9:12] == b"408"


async def test_bytes_that_trickle_do_not_extend_the_time_of_a_body(scene):
    limits = HttpLimits(body_s=SOON, body_bytes_per_s=1e6)
    async with served(scene, limits) as port, connected(port) as client:
        client.send(POST + b"Content-Length: 60000\r\n\r\n")

        async def trickle() -> None:
            while True:
                client.send(b" ")
                await asyncio.sleep(SOON / 10)

        trickling = asyncio.create_task(trickle())
        answer = await client.some()
        trickling.cancel()
    assert answer[9:12] == b"408"


async def test_silent_connections_give_way_to_one_that_asks(scene):
    async with served(scene, HttpLimits(connections=4)) as port, AsyncExitStack() as crowd:
        for _ in range(20):
            await crowd.enter_async_context(connected(port))
        for _ in range(3):
            async with connected(port) as client:
                client.send(ALIVE)
                assert (await client.some())[9:12] == b"200"


async def test_connections_beyond_those_at_work_are_refused_in_words(scene):
    async with served(scene, HttpLimits(connections=2)) as port, AsyncExitStack() as crowd:
        for _ in range(2):
            reader = await crowd.enter_async_context(connected(port))
            reader.send(STREAM)
            assert b"text/event-stream" in await reader.some()
        async with connected(port) as client:
            client.send(ALIVE)
            answer = await client.answer()
        assert answer[9:12] == b"503"
        assert b"retry-after" in answer
        assert b"all connections are in use" in answer


async def test_a_reader_that_does_not_read_loses_its_place(scene):
    limits = HttpLimits(stall_s=SOON, send_buffer_bytes=4096)
    scene.hear_all()
    async with served(scene, limits) as port:
        with socket.socket() as silent:
            silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            silent.setblocking(False)
            await asyncio.get_running_loop().sock_connect(silent, ("127.0.0.1", port))
            silent.send(STREAM)
            async with asyncio.timeout(5.0):
                while len(scene.state.readers) == 0:
                    await asyncio.sleep(0.001)
                while len(scene.state.readers) > 0:
                    scene.hear_event("x" * 1000)
                    await asyncio.sleep(0.001)


async def test_the_rest_of_a_refused_body_is_thrown_away_for_a_while_only(scene):
    limits = HttpLimits(json_bytes=1000, linger_s=SOON)
    async with served(scene, limits) as port, connected(port) as client:
        client.send(POST + b"Content-Length: 100000000\r\n\r\n" + b"x" * 100_000)
        answer = await client.answer()
    assert answer[9:12] == b"413"


class _Connection:
    def __init__(self, address: str = "127.0.0.1") -> None:
        self.address, self.gave_way = address, False

    def give_way(self) -> None:
        self.gave_way = True


def test_the_connection_that_has_idled_longest_gives_way():
    places = Connections(3, 1)
    first, second, third = crowd = [_Connection() for _ in range(3)]
    assert [places.admit(each) for each in crowd] == [None] * 3
    places.busy(first)
    places.busy(second)
    places.idle(second)
    assert places.admit(_Connection()) is None
    assert [each.gave_way for each in crowd] == [False, False, True]
    places.leave(third)
    assert len(places) == 3


def test_one_address_cannot_take_all_places_unless_it_is_loopback():
    places = Connections(10, 2)
    crowd = [_Connection("192.0.2.1") for _ in range(3)]
    assert [places.admit(each) for each in crowd] == [None, None, 429]
    places.leave(crowd[0])
    assert places.admit(crowd[2]) is None
    assert [places.admit(_Connection("::1")) for _ in range(5)] == [None] * 5


@pytest.mark.parametrize(
    ("limit", "opened", "most"),
    [(65_536, 40, 256), (1024, 40, 256), (300, 40, 196), (64, 40, 12), (40, 40, 4)],
)
def test_descriptors_are_kept_for_the_service_itself(limit, opened, most):
    assert affordable_connections(limit, 256, 64, opened) == most
