"""Fleet nodes, a router and machines as real processes, which are killed and cut off."""

import asyncio
import json
import signal
import time
from pathlib import Path

import pytest

from edge_service.bus.plant.session import PlantSession, PlantSettings
from edge_service.cli.entry import main
from edge_service.messages.plant import fleet_node

from .machines import say
from .plants import plant_in, until

pytestmark = pytest.mark.slow
MACHINES, AXES = 30, 4
ALL = MACHINES * AXES
MANY = ("--machines", str(MACHINES), "--axes", str(AXES))


def test_a_node_that_is_killed_or_cut_off_is_replaced_within_five_seconds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with plant_in(tmp_path) as plant:
        plant.node("one")
        plant.machines(*MANY)
        until(lambda: plant.shows("one", ALL))
        plant.node("two")
        until(lambda: plant.shows("two", ALL))
        shares = until_shared(plant.ask, "two")
        assert len(shares) == 2
        assert sum(shares.values()) == 64
        assert max(shares.values()) < 64
        plant.kill("one")
        killed_s = until(lambda: plant.reads_all("two", MACHINES) and plant.shows("two", ALL), 20.0)
        plant.node("one")
        until(lambda: plant.shows("one", ALL))
        until_shared(plant.ask, "two")
        plant.processes["one"].send_signal(signal.SIGSTOP)  # its connection stays, and is silent
        cut_s = until(lambda: plant.reads_all("two", MACHINES) and plant.shows("two", ALL), 20.0)
        plant.processes["one"].send_signal(signal.SIGCONT)
        until(lambda: len(until_known(plant.ask)) == 2)
        with capsys.disabled():
            say(f"{ALL} axes: taken over {killed_s:.1f} s after a kill, {cut_s:.1f} s after a cut")
        assert killed_s <= 5.0
        assert cut_s <= 8.0  # the lease of 4 s, a second to show it, and what a busy computer takes


def until_known(ask) -> dict[str, int]:
    """Fleet nodes that are there, with the parts that each reads."""
    return {each["name"]: each["parts"] for each in ask("two")["nodes"]}


def until_shared(ask, node: str) -> dict[str, int]:
    """Wait until the parts of the plant are divided; the parts of each."""
    until(lambda: sum(each["parts"] for each in ask(node)["nodes"]) == 64)
    return {each["name"]: each["parts"] for each in ask(node)["nodes"]}


def test_nothing_is_lost_when_the_router_is_killed_twice(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with plant_in(tmp_path) as plant:
        plant.node("one")
        until(lambda: plant.ask("one")["nodes"][0]["parts"] == 64)
        plant.machines("--machines", "10", "--axes", "4", "--period", "0.1", "--rounds", "400")
        until(lambda: plant.shows("one", 40))
        for _ in range(2):
            plant.kill("router")
            until(lambda: not plant.shows("one", 40))
            time.sleep(1.0)  # reports are made meanwhile
            plant.router()
            until(lambda: plant.shows("one", 40))
        assert plant.line("machines") == "done"
        until(lambda: plant.metric("one", "received") >= 4000)
        sent = plant.sent()
        received, lost = plant.metric("one", "received"), plant.metric("one", "lost")
        with capsys.disabled():
            say(f"{sent} reports sent, {received:.0f} received, {lost:.0f} lost")
        assert lost == 0.0
        assert sent == 4000


def test_a_router_ends_at_the_first_of_many_signals(tmp_path: Path) -> None:
    """As a terminal and a script send them: to the group, and again to each."""
    with plant_in(tmp_path) as plant:
        process = plant.processes["router"]
        for number in 3 * (signal.SIGINT, signal.SIGTERM):
            process.send_signal(number)
        assert process.wait(20.0) == 0


def test_a_part_that_is_not_shown_is_named_and_nobody_is_forgotten(tmp_path: Path) -> None:
    """A fleet node that is there, and neither reads nor answers."""
    with plant_in(tmp_path) as plant:
        for name in ("one", "two"):
            plant.node(name, keeps=True)
        plant.machines(*MANY)
        until(lambda: plant.shows("two", ALL))
        session = asyncio.run(PlantSession.open(PlantSettings(plant.endpoint)))
        token = session.zenoh.liveliness().declare_token(fleet_node("ghost"))

        def is_said() -> bool:
            answer = plant.ask("two")
            assert answer["axes"] == ALL
            said = " ".join(answer["missing"])
            silent = "the fleet node ghost does not answer" in said
            return silent and "part of the plant is not shown" in said

        until(is_said)
        token.undeclare()
        asyncio.run(session.close())
        until(lambda: plant.shows("two", ALL))
        plant.sent()
        until(lambda: plant.ask("two")["counts"]["UNAVAILABLE"] == ALL)
        row = plant.ask("two")["rows"][0]
        assert row["reason"].startswith("not heard since ")
        assert row["preload_percent"] is None
        time.sleep(11.0)  # the list is kept every 10 s
        for name in ("one", "two"):
            plant.kill(name)
        plant.node("two", keeps=True)
        until(lambda: plant.ask("two")["axes"] == ALL)
        assert plant.ask("two")["counts"]["UNAVAILABLE"] == ALL


def test_the_past_is_fetched_whole_also_when_a_node_dies_over_it(tmp_path: Path) -> None:
    with plant_in(tmp_path) as plant:
        plant.node("one", keeps=True)
        plant.machines("--machines", "6", "--axes", "2", "--log", "first", "--logged", "3000")
        until(lambda: plant.metric("one", "log_reports") > 0)
        plant.kill("one")
        plant.node("two", keeps=True)  # has nothing of what the other had
        plant.node("one", keeps=True)
        total = 3000
        paths = [f"/api/v1/fleet/hall{k % 2}/m{k:04d}/Y/history" for k in range(6)]

        def is_whole(path: str) -> bool:
            answer = plant.ask("two", path)
            numbers = [point["number"] for point in answer["points"]]
            assert numbers == sorted(set(numbers))
            assert answer["holes"] == []
            return numbers[-1:] == [total] and len(numbers) == 2000 and not answer["missing"]

        for path in paths:
            until(lambda: is_whole(path))  # noqa: B023


def test_the_command_prints_the_plant_and_what_is_wrong_with_a_question(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with plant_in(tmp_path) as plant:
        assert main(["fleet", "--plant", plant.endpoint]) == 2
        assert "no fleet node is there" in capsys.readouterr().err
        plant.node("one")
        plant.machines("--machines", "3", "--axes", "2")
        until(lambda: plant.shows("one", 6))
        assert main(["fleet", "--plant", plant.endpoint, "--json", "--timeout", "20"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["condition"] == "FAULT", document
        assert document["rows"][0]["axis"] == "X"
        assert document["rows"][0]["peers"]["faster"]
        assert document["missing"] == []
        assert main(["fleet", "--plant", plant.endpoint]) == 0
        assert "wears faster than its peers" in capsys.readouterr().out
    for wrong in (["--plant", "tcp/nonsense"], ["--plant", "tcp/plant:1"], ["--plant", "x", "y"]):
        assert main(["fleet", *wrong]) == 2
        assert capsys.readouterr().err.count("\n") == 1
