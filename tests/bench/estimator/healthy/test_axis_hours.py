"""Axis-hours of healthy axes: what is counted, and how the bound follows from it."""

from collections import Counter

import pytest

from .axis_hours import Shift, said_of, table, told, watched
from .false_conditions import WatchCount


def test_alarms_and_conditions_that_no_healthy_axis_has_count():
    count = WatchCount({"NORMAL": 2, "FAULT": 1, "WARNING": 0}, {"rate": 1}, {})
    assert said_of(count) == {"FAULT": 1, "rate": 1}


def test_without_any_alarm_the_bound_is_three_over_the_hours():
    line = table([Shift("own", 1, 100.0, Counter())]).splitlines()[-1]
    assert "0 false in 100.0 axis-hours" in line
    assert "at most 30.0 per 1000 axis-hours" in line  # -ln(0.05) / 100 h


def test_each_accused_axis_is_named():
    accused = table(
        [Shift("own", 41, 1.0, Counter({"model": 2})), Shift("own", 42, 1.0, Counter())]
    )
    assert "own 41: {'model': 2}" in accused
    assert "own 42" not in accused


def test_each_shift_is_told_as_it_comes(capsys: pytest.CaptureFixture[str]):
    shifts = told(
        iter([Shift("own", 41, 1.0, Counter({"rate": 1})), Shift("own", 42, 1.0, Counter())])
    )
    next(shifts)
    assert capsys.readouterr().err == "1: own 41: {'rate': 1}\n"
    next(shifts)
    assert capsys.readouterr().err == "2: own 42: silent\n"


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["own, one encoder", "foreign"])
def test_a_healthy_shift_is_silent(plant):
    assert watched(plant, 5003).said == {}
