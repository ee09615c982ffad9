"""Days of an axis compared: a known change is found at its size, and none where there is none."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from edge_service.fingerprint.compare import Drift, SectionDrift, compare_moves
from edge_service.fingerprint.moves import Move, find_moves
from edge_service.messages.samples import TIME, SampleFrame
from edge_service.offline.drift import DriftReport

from .. import foreign_plant as plant
from ..foreign_plant.ageing import Lubricant, Warmup
from ..foreign_plant.motions import Route

REPEATS = 6
_MOVES = ((0.25, 0.1), (0.20, 0.1), (0.50, 0.4), (0.20, 0.4))
"""Place, m, and speed, m/s, of each move of the part."""


@dataclass(frozen=True, slots=True)
class Day:
    preload_share: float = 1.0  # of the fresh preload
    friction: float = 1.0  # factor on all dry friction
    warm: bool = False  # whether it is warm from the start

    def events(self) -> tuple[Any, ...]:
        dry = dict.fromkeys(("guide", "nut", "bearing"), self.friction)
        heat = (Warmup(start=1.0),) if self.warm else ()
        return (Lubricant(**dry), *heat)


def moves_of(day: Day, seed: int, axis_seed: int = 0) -> list[Move]:
    machine = plant.Machine()
    route = Route(0.2)
    for _ in range(REPEATS):
        for place_m, speed_m_s in _MOVES:
            route.to(place_m, speed_m_s, 2.0, 0.2)
    case = plant.axis_case(
        day.preload_share * machine.preload_percent,
        setpoint_m=route.positions(),
        events=day.events(),
        seed=seed,
        axis_seed=axis_seed,
    )
    columns = dict(plant.simulate(case).columns)
    return find_moves(SampleFrame(columns.pop(TIME), columns), machine.lead_rad)


def compared(*days: Day, seed: int = 1) -> tuple[SectionDrift, ...]:
    """Comparison of recordings of these days, each with a noise of its own."""
    return compare_moves([moves_of(day, 100 * seed + k) for k, day in enumerate(days)])


SLOW = 0
"""The feed of the part, where dry friction is most of the torque."""


def drift_of(found: SectionDrift, name: str) -> Drift:
    return next(each for each in found.drifts if each.name == name)


def verdict(found: tuple[SectionDrift, ...]) -> str:
    return DriftReport("X", ("monday", "tuesday", "friday"), (), found).verdict


def test_a_day_without_a_change_has_none() -> None:
    found = compared(Day(), Day(), Day())
    assert len(found) == 2
    assert all(each.section.both_ways for each in found)
    assert not any(any(drift.changed) for each in found for drift in each.drifts)
    assert verdict(found).startswith("nothing changed beyond repeat scatter (compared: friction")


def test_more_friction_is_found_at_its_size_and_is_no_load() -> None:
    machine = plant.Machine()
    found = compared(Day(), Day(friction=1.1))[SLOW]
    friction = drift_of(found, "friction_nm")
    assert friction.since == 1
    assert friction.changes[-1].low < 0.1 * machine.coulomb_nm < friction.changes[-1].high
    assert friction.changes[-1].value == pytest.approx(0.1 * machine.coulomb_nm, rel=0.1)
    assert drift_of(found, "load_nm").since is None


def test_a_fifth_of_the_preload_less_is_that_much_less_drag() -> None:
    machine = plant.Machine()
    friction = drift_of(compared(Day(), Day(preload_share=0.8))[SLOW], "friction_nm")
    assert friction.since == 1
    assert friction.changes[-1].low < -0.2 * machine.preload_drag_nm < friction.changes[-1].high


def test_heat_is_named_where_it_was_warm() -> None:
    found = compared(Day(), Day(warm=True))
    assert drift_of(found[SLOW], "friction_nm").since == 1
    assert all(each.may_be_heat for each in found)
    assert "K warmer, which may be all of it" in verdict(found)


@pytest.mark.slow
def test_the_day_of_a_change_is_told_and_one_that_went_again() -> None:
    found = compared(Day(), Day(), Day(friction=1.15), Day(friction=1.15))[SLOW]
    assert drift_of(found, "friction_nm").since == 2
    gone = drift_of(compared(Day(), Day(friction=1.15), Day())[SLOW], "friction_nm")
    assert gone.since is None
    assert gone.changed == (True, False)


def drawn(rng: np.random.Generator, memory: float) -> list[Move]:
    """Moves there and back whose torque has 3 % of scatter with a memory from repeat to repeat."""
    moves, error = [], rng.standard_normal()
    for number in range(24):
        error = memory * error + np.sqrt(1.0 - memory**2) * rng.standard_normal()
        way = 1.0 if number % 2 else -1.0
        figures = {
            "torque_nm": way * 0.3 * (1.0 + 0.03 * error) + 0.05,
            "torque_spread_nm": 0.02 * (1.0 + 0.1 * rng.standard_normal()),
            "following_error_m": way * 1e-4 + 5e-6 * rng.standard_normal(),
        }
        ends = (0.1, 0.3) if way > 0 else (0.3, 0.1)
        moves.append(Move((), *ends, way * 0.1, 2.1, figures))
    return moves


@pytest.mark.slow
@pytest.mark.parametrize("memory", [0.0, 0.5])
def test_a_healthy_axis_is_rarely_accused(memory: float) -> None:
    """At most one report in twenty, of three recordings with all their quantities."""
    rng = np.random.default_rng(5)
    accused = 0
    for _ in range(200):
        found = compare_moves([drawn(rng, memory) for _ in range(3)])
        accused += any(any(drift.changed) for each in found for drift in each.drifts)
    assert accused <= 0.05 * 200


def test_what_is_not_repeated_in_every_recording_is_not_compared() -> None:
    rng = np.random.default_rng(7)
    assert compare_moves([drawn(rng, 0.0), drawn(rng, 0.0)[:3]]) == ()


@pytest.mark.slow
def test_forty_healthy_days_of_other_axes_accuse_none_too_often() -> None:
    accused = 0
    for seed in range(2, 42):
        found = compared(Day(), Day(), seed=seed)
        accused += any(any(drift.changed) for each in found for drift in each.drifts)
    assert accused <= 2
