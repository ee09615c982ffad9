"""Whole plant as one fleet node shows it: what it reads itself, and what the others answer."""

import asyncio
from collections.abc import Mapping

from ...clock import now_ns, steady_ns
from ...health.fleet.plant_rows import PlantTable, plant_table
from ...http_api.fleet.desk import AxisPast
from ...kept_database import DatabaseFailedError
from ...messages.fleet import HistoryPoint, HistoryQuestion, Hole
from ...threads import Threads
from .backfill import Backfill
from .reader import FleetReader

FRESH_NS = 1_000_000_000
"""Age below which a table is not made anew."""
SHOWN_NS = 3_000_000_000
"""Age up to which it is shown while a new one is made."""
WANTED_NS = 10_000_000_000
"""Time after a request for which tables are made without being asked for."""
LEARN_NS = 15_000_000_000
"""Period in which a node learns what the others know, whether anybody asks or not."""
_MERGER = Threads("fleet table", 1)


class PlantDesk:
    """Answers the routes of one fleet node."""

    def __init__(self, reader: FleetReader, backfill: Backfill) -> None:
        self.name = reader.name
        self._backfill = backfill
        self._reader = reader
        self._lock = asyncio.Lock()
        self._made_ns = 0
        self._wanted_ns = -WANTED_NS
        self._table = PlantTable((), (), ())
        self.asked_s = self.merged_s = 0.0

    async def table(self) -> PlantTable:
        """All axes of the plant, as of some seconds ago at most."""
        self._wanted_ns = steady_ns()
        if self._age_ns() >= SHOWN_NS:
            await self._renew(SHOWN_NS)
        return self._table

    async def look(self) -> None:
        """Make the table anew where somebody reads it, or the others have not been asked for long.

        To be called a few times a second.
        """
        wanted = steady_ns() - self._wanted_ns < WANTED_NS
        await self._renew(FRESH_NS if wanted else LEARN_NS)

    def _age_ns(self) -> int:
        return steady_ns() - self._made_ns if self._made_ns else SHOWN_NS

    async def _renew(self, age_ns: int) -> None:
        """Make the table anew if it is so old, and nobody else does."""
        async with self._lock:
            if self._made_ns == 0 or self._age_ns() >= age_ns:
                await self._ask()

    async def _ask(self) -> None:
        began_ns = steady_ns()
        others = await self._reader.others()
        self.asked_s = (steady_ns() - began_ns) / 1e9
        answers = [self._reader.told(), *others]
        began_ns = steady_ns()
        self._table = await _MERGER.run(plant_table, answers, self._reader.names)
        self._made_ns = steady_ns()
        self.merged_s = (self._made_ns - began_ns) / 1e9

    async def past(self, question: HistoryQuestion) -> AxisPast:
        """Kept past of one axis, from all fleet nodes."""
        missing = []
        answers = await self._reader.pasts(question)
        try:
            answers[self.name] = await self._backfill.past(question)
        except DatabaseFailedError as error:
            missing.append(f"the history of this fleet node cannot be read now: {error}")
        silent = sorted(self._reader.names - answers.keys() - {self.name})
        missing += [f"the fleet node {name} does not answer" for name in silent]
        points = {(each.log, each.number): each for a in answers.values() for each in a.points}
        holes = {(each.log, each.first): each for a in answers.values() for each in a.holes}
        ordered = sorted(points.values(), key=lambda each: (each.time_ns, each.number))
        left = [hole for hole in holes.values() if _is_gone(hole, points)]
        return AxisPast(tuple(ordered[-question.most :]), tuple(left), tuple(missing))

    async def remove(self, site: str, machine: str) -> bool:
        """Take a machine out of the list until it is heard again; False if it is not known."""
        removed = self._reader.machines.remove((site, machine), now_ns())
        self._made_ns = 0
        return removed

    def unready(self) -> list[str]:
        """Reasons for which the node does not do its work now."""
        reader = self._reader
        if not reader.is_connected:
            return ["no router of the plant answers"]
        return [] if reader.buckets else ["no part of the plant is read here yet"]

    def counters(self) -> Mapping[str, int]:
        """Counts since the start, by name."""
        reader = self._reader
        counts = {} if reader.reports is None else reader.reports.counts()
        lost = sum(machine.lost for machine in reader.machines)
        return counts | self._backfill.counts | {"lost": lost, "divisions": reader.takeovers}

    def readings(self) -> Mapping[str, float]:
        """Values now, by name."""
        reader = self._reader
        return {
            "parts": float(len(reader.buckets)),
            "machines": float(len(reader.machines)),
            "connected": float(reader.is_connected),
            "division_s": reader.divided_s,
            "asking_s": self.asked_s,
            "merging_s": self.merged_s,
        }

    def refused(self) -> Mapping[tuple[str, str], int]:
        """Payloads that were refused, by key and reason."""
        return self._reader.refused()


def _is_gone(hole: Hole, points: Mapping[tuple[str, int], HistoryPoint]) -> bool:
    """Tell whether no node has what one of them lacks."""
    return not all((hole.log, number) in points for number in range(hole.first, hole.last + 1))
