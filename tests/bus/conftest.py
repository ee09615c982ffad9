from collections.abc import AsyncIterator

import pytest

from edge_service.bus.session import Bus, BusSettings


@pytest.fixture
async def router() -> AsyncIterator[Bus]:
    bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    yield bus
    await bus.close()
