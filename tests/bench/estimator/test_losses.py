"""Courses of a lost preload, and one short shift of each kind."""

import numpy as np
import pytest

from .healthy.axis_hours import PLANTS
from .losses import CASES, drawn_course, lost


@pytest.mark.parametrize("case", CASES)
def test_a_course_begins_fresh_or_worn_and_never_rises(case: str):
    courses = [drawn_course(case, seed) for seed in range(1, 30)]
    shares = [np.interp(np.linspace(0.0, 600.0, 500), *np.array(each).T) for each in courses]
    assert all(np.all(np.diff(each) <= 0.0) for each in shares)
    ends = np.array([(each[0], each[-1]) for each in shares])
    assert np.all((ends[:, 0] == 1.0) == (case != "worn at the start"))
    assert np.all((ends[:, 1] == 1.0) == (case == "healthy"))
    assert np.all((ends[:, 1] == 0.0) == (case == "all lost at once"))


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
def test_a_loss_is_scored_against_the_truth_of_the_plant(plant: str):
    found, fresh = lost(plant, "worn at the start", 26000, 60.0)
    share = drawn_course("worn at the start", 26000)[0][1]
    assert fresh == pytest.approx(6.8 * (1.0 - share), abs=0.3)
    assert found.answered > 300
