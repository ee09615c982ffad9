"""No broker, whatever it does, ends the delivery, loses a message or upsets their order."""

import asyncio
from pathlib import Path

import pytest

from edge_service.bus.mqtt.delivery import MqttDelivery, MqttSettings
from edge_service.bus.mqtt.plain_json import PlainJson
from edge_service.bus.spool.spool import Spool

from .brokers import MISBEHAVING, serving
from .conftest import empty, stop

TRIES = 2


async def no_pause(_seconds: float) -> None:
    await asyncio.sleep(0)


@pytest.mark.parametrize("ways", [("poison",), ("ignored",), ("poison", "ignored")])
@pytest.mark.parametrize("bad", [{0}, {3}, {3, 4, 5}, {0, 5, 6, 11}])
async def test_a_message_at_which_the_broker_breaks_off_is_a_dead_letter_and_the_others_go(
    bad: set[int], ways: tuple[str, ...], tmp_path: Path
) -> None:
    async with serving() as broker:
        refused = frozenset(b"<%d>" % number for number in bad)
        for way in ways:
            setattr(broker, way, refused)
        spool = await Spool.open(tmp_path / "spool", 100_000)
        for number in range(20):
            await spool.put("X/x", b"<%d>" % number)
        settings = MqttSettings("127.0.0.1", broker.port, "test", timeout_s=0.1)
        delivery = MqttDelivery(settings, PlainJson("t"), spool, lambda _problem: None, no_pause)
        delivering = asyncio.create_task(delivery.run())
        count = 20
        while spool.dead < len(bad):  # by what comes later the last ones are judged
            await spool.put("X/x", b"<%d>" % count)
            count += 1
            await asyncio.sleep(0.02)
        await empty(spool)
        first = list(dict.fromkeys(broker.taken))
        assert {letter.payload for letter in await spool.letters()} == refused
        expected = [b"<%d>" % number for number in range(count) if number not in bad]
        assert sorted(first) == sorted(expected)
        if ways == ("poison",):  # what is not acknowledged in time does not hold up the others
            assert first == expected
        await stop(delivering)
        spool.close()


@pytest.mark.parametrize("name", MISBEHAVING)
async def test_a_broker_that_comes_to_its_senses_gets_all_in_order(
    name: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async with serving() as broker:
        broker.manner = MISBEHAVING[name]
        problems: list[str] = []

        def tell(problem: str) -> None:
            if problem:
                problems.append(problem)
            if len(problems) == TRIES:
                broker.manner = None

        async def sleep(_seconds: float) -> None:
            await asyncio.sleep(0)

        spool = await Spool.open(tmp_path / "spool", 1000)
        for number in range(5):
            await spool.put("X/x", b"%d" % number)
        settings = MqttSettings("127.0.0.1", broker.port, "test", timeout_s=0.3)
        delivery = MqttDelivery(settings, PlainJson("t"), spool, tell, sleep)
        delivering = asyncio.create_task(delivery.run())
        await empty(spool)
        assert not delivering.done()
        assert list(dict.fromkeys(map(int, broker.taken))) == list(range(5))  # at least once
        assert [record for record in caplog.records if record.exc_info] == []
        assert (spool.dropped, spool.dead) == (0, 0)
        assert len(problems) >= TRIES
        assert all(each.startswith(f"127.0.0.1:{broker.port}: ") for each in problems)
        await stop(delivering)
        spool.close()
