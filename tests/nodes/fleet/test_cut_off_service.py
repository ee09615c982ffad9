"""A real service that is cut off from its plant: what it kept meanwhile is fetched, once each."""

import json
import sqlite3
from contextlib import closing
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from edge_service.cli.entry import main
from edge_service.nodes.stores.report_log import FILE

from ...bench.faults.scene import configuration
from .plants import Plant, plant_in, until

pytestmark = pytest.mark.slow
_CUT_REPORTS = 9
"""An hour and a half of a log that takes a report in 600 s; here it takes one a second."""


def test_a_service_that_was_cut_off_for_more_than_an_hour_is_fetched_whole(tmp_path: Path) -> None:
    kept = tmp_path / "history" / FILE
    with plant_in(tmp_path) as plant:
        plant.node("one", keeps=True)
        start_service(plant, tmp_path)
        until(lambda: plant.shows("one", 1))
        (row,) = plant.ask("one")["rows"]
        path = f"/api/v1/fleet/{row['site']}/{row['machine']}/{row['axis']}/history"
        until(lambda: len(plant.ask("one", path)["points"]) > 0)
        plant.kill("router")
        first = max(logged(kept))
        until(lambda: max(logged(kept)) >= first + _CUT_REPORTS)
        fetched = [point["number"] for point in plant.ask("one", path)["points"]]
        assert max(fetched) <= first + 1  # a report that was on its way
        plant.router()
        until(lambda: plant.ask("one", path)["points"][-1]["number"] > first + _CUT_REPORTS)
        answer = plant.ask("one", path)
    own = logged(kept)
    numbers = [point["number"] for point in answer["points"]]
    assert numbers == list(range(1, numbers[-1] + 1))
    assert answer["holes"] == [] and not answer["missing"]
    times = [own[number] for number in numbers]
    assert times == sorted(times)
    for point, time_ns in zip(answer["points"], times, strict=True):
        told_s = datetime.fromisoformat(point["time"]).timestamp()
        assert told_s == pytest.approx(1e-9 * time_ns, abs=2e-3)


def test_a_plant_is_read_by_mutual_tls_and_not_by_strangers(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    for folder in (ours, theirs):
        assert main(["certs", "--out", str(folder)]) == 0
    with plant_in(tmp_path, ours) as plant:
        for name in ("one", "two", "three"):
            plant.node(name)
        start_service(plant, tmp_path)
        for name in ("one", "two", "three"):
            until(lambda: plant.shows(name, 1))  # noqa: B023
        assert len(plant.ask("one")["nodes"]) == 3
        plant.node("stranger", certificates=theirs)
        until(
            lambda: "none that trusts this certificate" in (tmp_path / "stranger.log").read_text()
        )
        assert plant.ask("stranger")["axes"] == 0
        assert len(plant.ask("one")["nodes"]) == 3


def start_service(plant: Plant, folder: Path) -> None:
    """Start a service with one axis that reports to the plant."""
    path = folder / "edge.toml"
    tables = f"[plant]\n{plant.access('plant')}log_period_s = 1.0\n"
    path.write_text(configuration(folder=folder / "history", tables=tables), "utf-8")
    plant.start("edge", "edge_service", "run", str(path))


def logged(kept: Path) -> dict[int, int]:
    """Time of each report in a service's own log, ns, by its number."""
    with closing(sqlite3.connect(f"file:{kept}?mode=ro", uri=True)) as file:
        rows: list[Any] = file.execute("SELECT number, content FROM reports").fetchall()
    return {number: json.loads(content)["time_ns"] for number, content in rows}
