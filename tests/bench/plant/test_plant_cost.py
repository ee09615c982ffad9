"""The page on what a plant costs says what follows from the figures beside it; the bench runs."""

import re
from dataclasses import astuple

import pytest

from ...documents import ROOT
from .bench import PlantBenchSettings, run_plant_bench
from .cost import Measured, plant_cost

PAGE = (ROOT / "deploy" / "PLANT.md").read_text("utf-8")


def number(text: str) -> float:
    return float(text.replace(",", ""))


def figure(before: str, after: str) -> float:
    """The number between two texts of the page."""
    found = re.search(re.escape(before) + r"\s*([\d.,]+) " + re.escape(after), PAGE)
    assert found is not None, (before, after)
    return number(found[1])


def measured() -> Measured:
    return Measured(
        report_bytes=8.0 * figure("| report on the bus |", "bytes"),
        read_us=figure("| report read by a fleet node |", "µs"),
        table_us=figure("whose page is looked at |", "µs"),
        router_us=figure("| report passed on by a router |", "µs"),
        number_us=figure("| number of the last report passed on by a router |", "µs"),
        axis_kb=figure("| axis of the whole plant, on each node |", "kB"),
        node_mb=figure("of memory, beside", "MB"),
        point_bytes=figure("in the store of a fleet node |", "bytes"),
        logged_bytes=1e3 * figure("| report in the machine's own log (every 600 s) |", "kB"),
    )


def test_what_a_plant_costs_follows_from_what_was_measured() -> None:
    table = PAGE.partition("So a plant costs:")[2]
    rows = re.findall(r"^\| ([\d,]+) \| (\d+) \| (\d+) s \| (.+) \|$", table, re.MULTILINE)
    assert len(rows) >= 5
    for axes, nodes, period, rest in rows:
        cost = plant_cost(int(number(axes)), measured(), int(nodes), float(period))
        said = [number(each) for each in rest.split(" | ")]
        assert said == pytest.approx(astuple(cost)[: len(said)], rel=0.01)


def test_reading_is_shared_and_the_table_is_not() -> None:
    figures = Measured(5000.0, 20.0, 30.0, 5.0, 10.0, 10.0, 100.0, 100.0, 5000.0)
    two, four = plant_cost(8000, figures, 2), plant_cost(8000, figures, 4)
    assert two.messages_s == 1000.0
    assert two.mb_s == pytest.approx(5.0)
    assert two.router_cores == pytest.approx(0.048)
    assert two.node_cores == pytest.approx(0.08 + 0.24)
    assert four.node_cores == pytest.approx(0.04 + 0.24)
    assert two.node_mb == 180.0
    assert two.store_mb_day == pytest.approx(8000 * 144 * 100 / 1e6)
    assert two.log_mb_day == pytest.approx(0.72)


@pytest.mark.slow
def test_nothing_is_lost_by_a_small_plant_whose_routers_are_killed() -> None:
    settings = PlantBenchSettings(6.0, losing_axes=32, many_axes=64, window_s=2.0)
    bench = run_plant_bench(settings, lambda _line: None)
    assert bench.value("losing_sent") == 4 * 60
    assert bench.value("losing_received") == bench.value("losing_sent")
    assert bench.value("losing_lost") == bench.value("many_lost") == 0.0
    assert bench.value("many_axis_us") > 0.0
