"""Questions of the routes to a fleet node."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from ...health.fleet.plant_rows import PlantTable
from ...messages.fleet import HistoryPoint, HistoryQuestion, Hole


@dataclass(frozen=True, slots=True)
class AxisPast:
    """Kept past of one axis, the oldest first.

    Attributes:
        holes: reports of its machine's logs that nobody has any more.
        missing: what may be missing besides, a sentence each.
    """

    points: tuple[HistoryPoint, ...]
    holes: tuple[Hole, ...] = ()
    missing: tuple[str, ...] = ()


class FleetDesk(Protocol):
    """One fleet node, as its interface needs it.

    Attributes:
        name: of the node.
    """

    name: str

    async def table(self) -> PlantTable:
        """All axes of the plant, as of a second ago at most."""
        ...

    async def past(self, question: HistoryQuestion) -> AxisPast:
        """Kept past of one axis, from all fleet nodes."""
        ...

    async def remove(self, site: str, machine: str) -> bool:
        """Take a machine out of the list until it is heard again; False if it is not known."""
        ...

    def unready(self) -> list[str]:
        """Reasons for which the node does not do its work now."""
        ...

    def counters(self) -> Mapping[str, int]:
        """Counts since the start, by name."""
        ...

    def readings(self) -> Mapping[str, float]:
        """Values now, by name."""
        ...

    def refused(self) -> Mapping[tuple[str, str], int]:
        """Payloads that were refused, by key and reason."""
        ...
