"""Payloads of an axis on the bus while a test goes on."""

import asyncio

from edge_service.bus.session import Bus
from edge_service.messages.features import FeatureBlock
from edge_service.messages.health import ComponentStatus
from edge_service.messages.keys import MachineKeys
from edge_service.messages.topics import FEAT, STATUS


class Heard:
    """Payloads of the axis on the bus."""

    def __init__(self, bus: Bus, keys: MachineKeys) -> None:
        self.features: list[FeatureBlock] = []
        self.statuses: list[ComponentStatus] = []
        self._feat = bus.subscribe(keys.all_axes(FEAT), FEAT)
        self._status = bus.subscribe(keys.all_components(STATUS), STATUS)
        self._tasks = [
            asyncio.create_task(self._follow_features()),
            asyncio.create_task(self._follow_statuses()),
        ]

    async def _follow_features(self) -> None:
        async for _, _, block in self._feat:
            self.features.append(block)

    async def _follow_statuses(self) -> None:
        async for _, _, report in self._status:
            if report.component == "acquire":
                self.statuses.append(report.status)

    async def status(self, wanted: ComponentStatus) -> None:
        """Wait until the driver's node reports a status."""
        while not self.statuses or self.statuses[-1] is not wanted:
            await asyncio.sleep(0.01)

    async def more(self, count: int) -> None:
        wanted = len(self.features) + count
        while len(self.features) < wanted:
            await asyncio.sleep(0.02)

    def close(self) -> None:
        for task in self._tasks:
            task.cancel()
        self._feat.close()
        self._status.close()
