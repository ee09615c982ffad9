"""Days of an axis that makes the same part again and again, on a plant that shares no code."""

from dataclasses import dataclass
from typing import Any

from edge_service.fingerprint.drift import SectionDrift, compare_moves
from edge_service.fingerprint.moves import Move, find_moves
from edge_service.messages.channels import TIME
from edge_service.messages.samples import Floats, SampleFrame

from ... import foreign_plant as plant
from ...foreign_plant.ageing import Lubricant, Warmup
from ...foreign_plant.motions import Route

REPEATS = 6
_MOVES = ((0.25, 0.1), (0.20, 0.1), (0.50, 0.4), (0.20, 0.4))
"""Place, m, and speed, m/s, of each move of the part."""


@dataclass(frozen=True, slots=True)
class Day:
    """State of the axis on one day.

    Attributes:
        preload_share: of the fresh preload.
        friction: factor on all dry friction.
        warm: whether it is warm from the start.
    """

    preload_share: float = 1.0
    friction: float = 1.0
    warm: bool = False

    def events(self) -> tuple[Any, ...]:
        """Settings that the plant is told."""
        dry = dict.fromkeys(("guide", "nut", "bearing"), self.friction)
        heat = (Warmup(start=1.0),) if self.warm else ()
        return (Lubricant(**dry), *heat)


def moves_of(day: Day, seed: int, axis_seed: int = 0) -> list[Move]:
    """Moves of a recording of that day."""
    machine = plant.Machine()
    case = plant.axis_case(
        day.preload_share * machine.preload_percent,
        setpoint_m=_part(),
        events=day.events(),
        seed=seed,
        axis_seed=axis_seed,
    )
    columns = dict(plant.simulate(case).columns)
    return find_moves([SampleFrame(columns.pop(TIME), columns)], machine.lead_rad)


def compared(*days: Day, seed: int = 1) -> tuple[SectionDrift, ...]:
    """Comparison of recordings of these days, each with a noise of its own."""
    return compare_moves([moves_of(day, 100 * seed + k) for k, day in enumerate(days)])


def _part() -> Floats:
    route = Route(0.2)
    for _ in range(REPEATS):
        for place_m, speed_m_s in _MOVES:
            route.to(place_m, speed_m_s, 2.0, 0.2)
    return route.positions()
