"""The bus: loopback only, never blocked by a reader, every loss counted."""

import asyncio
import time
from collections.abc import AsyncIterator
from dataclasses import replace

import numpy as np
import pytest
import zenoh

from edge_service.bus.session import Bus, BusConfigurationError, BusSettings, BusUnavailableError
from edge_service.bus.settings import MOST_AT_ONCE, zenoh_config
from edge_service.messages.codec import Header
from edge_service.messages.event import AxisCondition, Event
from edge_service.messages.keys import MachineKeys
from edge_service.messages.samples import TORQUE, SampleFrame
from edge_service.messages.topics import EVENT, RAW

KEYS = MachineKeys("site", "machine")
FRAME = SampleFrame(np.array([0.0, 1e-3]), {TORQUE: np.array([0.1, 0.2])})


@pytest.fixture
async def client(router: Bus) -> AsyncIterator[Bus]:
    bus = await Bus.open(BusSettings(router.endpoint, "client"))
    yield bus
    await bus.close()


async def test_payloads_arrive_in_one_process_and_across_sessions(router: Bus, client: Bus) -> None:
    near = router.subscribe(KEYS.all_axes(RAW), RAW)
    far = client.subscribe(KEYS.all_axes(RAW), RAW)
    publisher = router.publisher(KEYS.key("X", RAW), RAW, "X")
    headers = [publisher.publish(FRAME, time.time_ns())]
    assert (await anext(aiter(near)))[:2] == ("X", headers[0])
    assert (headers[0].sequence, headers[0].boot_epoch) == (0, publisher.boot_epoch)
    arrivals = aiter(far)
    async with asyncio.timeout(60.0):
        first = asyncio.ensure_future(anext(arrivals))
        while not first.done():
            headers.append(publisher.publish(FRAME, time.time_ns()))
            await asyncio.sleep(0)
        axis, header, frame = await first
    assert axis == "X"
    assert header in headers
    np.testing.assert_array_equal(frame.channels[TORQUE], FRAME.channels[TORQUE])


async def test_the_first_payload_of_a_client_arrives() -> None:
    router = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", read_only=False))
    near = router.subscribe(KEYS.all_axes(RAW), RAW)
    client = await Bus.open(BusSettings(router.endpoint, "client"))
    client.publisher(KEYS.key("X", RAW), RAW, "X").publish(FRAME, 0)
    async with asyncio.timeout(60.0):
        assert (await anext(aiter(near)))[1].sequence == 0
    await client.close()
    await router.close()


async def test_nothing_is_encoded_while_nobody_else_listens(
    router: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(RAW), "encode", None)
    subscriber = router.subscribe(KEYS.key("X", RAW), RAW)
    router.publisher(KEYS.key("X", RAW), RAW, "X").publish(FRAME, 0)
    subscriber.close()
    assert [frame async for _, _, frame in subscriber] == [FRAME]


async def test_events_that_come_together_all_cross_a_link(router: Bus, client: Bus) -> None:
    """Each is urgent, so it travels in a batch of its own; there have to be batches enough."""
    far = client.subscribe(KEYS.key("X", EVENT), EVENT)
    publisher = router.publisher(KEYS.key("X", EVENT), EVENT, "X")
    event = Event(axis="X", kind="part", level=AxisCondition.NORMAL, text="one of many", time_ns=1)
    arrivals = aiter(far)
    async with asyncio.timeout(60.0):
        first = asyncio.ensure_future(anext(arrivals))
        while not first.done():
            publisher.publish(event, 1)
            await asyncio.sleep(0.02)
        sent = [publisher.publish(event, 1).sequence for _ in range(MOST_AT_ONCE)]
        async for _, header, _ in arrivals:
            if header.sequence >= sent[-1]:
                break
    assert far.counts()["lost_payloads"] == 0


async def test_a_reader_that_sleeps_loses_the_oldest_and_the_count_is_exact(router: Bus) -> None:
    subscriber = router.subscribe(KEYS.all_axes(RAW), RAW, depth=4)
    publisher = router.publisher(KEYS.key("X", RAW), RAW, "X")
    for _ in range(10):
        publisher.publish(FRAME, 0)
    subscriber.close()
    assert [header.sequence async for _, header, _ in subscriber] == [6, 7, 8, 9]
    assert (subscriber.counts()["received"], subscriber.counts()["ring_overruns"]) == (10, 6)


async def test_holes_and_foreign_bytes_are_counted(router: Bus) -> None:
    subscriber = router.subscribe(KEYS.all_axes(RAW), RAW)
    raw = router._session.declare_publisher(KEYS.key("X", RAW))
    for sequence in (0, 1, 5):
        raw.put(RAW.encode("X", Header(sequence, 1, 0, 0), FRAME))
    raw.put(b"no block")
    subscriber.close()
    assert len([item async for item in subscriber]) == 3
    assert (subscriber.counts()["lost_payloads"], subscriber.counts()["malformed"]) == (3, 1)


async def test_a_stalled_foreign_reader_never_blocks_the_publisher(router: Bus) -> None:
    config = zenoh_config(BusSettings(router.endpoint, "client"))
    stalled = await asyncio.to_thread(zenoh.open, config)
    subscriber = stalled.declare_subscriber(KEYS.key("X", RAW), zenoh.handlers.FifoChannel(1))
    publisher = router.publisher(KEYS.key("X", RAW), RAW, "X")
    big = SampleFrame(np.zeros(5_000), {TORQUE: np.zeros(5_000)})
    near = router.subscribe(KEYS.key("X", RAW), RAW, depth=1000)
    try:
        async with asyncio.timeout(60.0):
            for _ in range(300):
                publisher.publish(big, 0)
                await asyncio.sleep(0)
        near.close()
        assert len([item async for item in near]) == 300
    finally:
        subscriber.undeclare()
        await asyncio.to_thread(stalled.close)


async def test_the_last_payload_answers_a_query(router: Bus, client: Bus) -> None:
    publisher = router.publisher(KEYS.key("X", RAW), RAW, "X")
    publisher.publish(FRAME, 5)
    publisher.publish(FRAME, 6)

    def ask() -> list[Header]:
        replies = client._session.get(KEYS.key("X", RAW))
        headers = [RAW.decode(r.ok.payload.to_bytes())[1] for r in replies if r.ok]
        return [replace(each, monotonic_time_ns=0) for each in headers]

    async with asyncio.timeout(60.0):  # declarations travel asynchronously
        while Header(1, publisher.boot_epoch, 6, 0) not in await asyncio.to_thread(ask):
            await asyncio.sleep(0)


@pytest.mark.parametrize(
    "endpoint", ["tcp/0.0.0.0:0", "tcp/192.0.2.1:7447", "udp/127.0.0.1:0", "127.0.0.1", "tcp/x:1"]
)
async def test_other_than_loopback_is_refused(endpoint: str) -> None:
    with pytest.raises(BusConfigurationError, match=r"loopback|form"):
        await Bus.open(BusSettings(endpoint, "router"))


async def test_a_taken_port_is_one_clear_line(router: Bus) -> None:
    with pytest.raises(BusConfigurationError, match="in use by another process"):
        await Bus.open(BusSettings(router.endpoint, "router"))


async def test_no_bus_to_join_is_one_clear_line(router: Bus) -> None:
    await router.close()
    with pytest.raises(BusUnavailableError, match="no bus answers"):
        await Bus.open(BusSettings(router.endpoint, "client"))


async def test_a_reader_that_rests_is_woken_by_what_comes_later_or_by_too_much(router: Bus) -> None:
    reader = router.subscribe(KEYS.all_axes(RAW), RAW)
    publishers = {axis: router.publisher(KEYS.key(axis, RAW), RAW, axis) for axis in "XY"}
    heard: list[str] = []

    async def read() -> None:
        async for axis, _, _ in reader:
            heard.append(axis)
            if axis == "X":
                reader.rest("X", 0.2)

    async def published(axis: str) -> None:
        publishers[axis].publish(FRAME, time.time_ns())
        for _ in range(5):
            await asyncio.sleep(0)

    reading = asyncio.create_task(read())
    await asyncio.sleep(0)
    await published("X")
    assert heard == ["X"]
    begun_s = time.monotonic()
    await published("X")
    assert heard == ["X"] or time.monotonic() - begun_s > 0.2  # a busy machine may take so long
    await published("Y")  # who does not rest wakes the reader for all
    assert sorted(heard) == ["X", "X", "Y"]
    for _ in range(40):
        await published("X")
    assert len(heard) > 20
    async with asyncio.timeout(60.0):
        while len(heard) < 43:  # what is left is read though nothing more comes
            await asyncio.sleep(0.01)
    publishers["X"].publish(FRAME, time.time_ns())
    time.sleep(0.25)  # noqa: ASYNC251
    await asyncio.sleep(0.01)
    await published("X")
    assert len(heard) == 45  # what was read late makes the next no later
    reader.close()
    await reading
