import numpy as np
import pytest

from edge_service.models.screw.wear import SCENARIOS, Wear

LIFE_S = 3600.0


def at(wear: Wear, *ages: float) -> list[float]:
    return [float(p) for p in wear.preload_percent(np.array(ages) * LIFE_S, LIFE_S)]


def test_gradual_loss_is_a_straight_line_between_two_holds() -> None:
    ages = (-1.0, 0.0, 0.05, 0.25, 0.5, 1.0, 3.0)
    assert at(SCENARIOS["gradual"], *ages) == pytest.approx([10, 10, 9.5, 7.5, 5, 0, 0])


def test_partial_loss_starts_and_ends_elsewhere() -> None:
    assert at(SCENARIOS["partial"], 0.0, 0.5, 1.0) == pytest.approx([7.5, 5.0, 2.5])


def test_sudden_loss_comes_whole_at_half_of_the_life() -> None:
    before = np.nextafter(0.5, 0.0)
    assert at(SCENARIOS["sudden"], 0.0, before, 0.5, 1.0) == [10.0, 10.0, 0.0, 0.0]
