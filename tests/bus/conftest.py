from collections.abc import AsyncIterator

import pytest

from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings


@pytest.fixture
async def router() -> AsyncIterator[Bus]:
    bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    yield bus
    await bus.close()
