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
