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


def test_healthy_never_changes() -> None:
    assert at(SCENARIOS["healthy"], -1.0, 0.0, 0.5, 2.0) == [10.0] * 4


def test_sudden_loss_comes_whole_at_half_of_the_life() -> None:
    before = np.nextafter(0.5, 0.0)
    assert at(SCENARIOS["sudden"], 0.0, before, 0.5, 1.0) == [10.0, 10.0, 0.0, 0.0]


def test_running_in_is_steeper_and_then_linear() -> None:
    wear = Wear(10.0, 0.0, run_in_loss=0.4)
    assert at(wear, 0.0, 0.05, 0.1, 0.55, 1.0) == pytest.approx([10.0, 8.0, 6.0, 3.0, 0.0])


@pytest.mark.parametrize("run_in_loss", [0.0, 0.1, 0.7, 1.0])
def test_loss_never_turns_back(run_in_loss: float) -> None:
    values = at(Wear(9.0, 1.0, run_in_loss=run_in_loss), *np.linspace(-0.1, 1.1, 500))
    assert np.all(np.diff(values) <= 1e-12)


def test_impossible_numbers_are_refused_in_one_line() -> None:
    with pytest.raises(ValueError, match="must not be negative, got 10 to -1"):
        Wear(10.0, -1.0)
    with pytest.raises(ValueError, match="run_in_loss must lie in 0 to 1"):
        Wear(10.0, 0.0, run_in_loss=1.5)
