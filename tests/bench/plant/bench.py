"""A plant in processes of its own: what is lost when routers die, what an axis costs."""

import math
import signal
import tempfile
import time
import urllib.error
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ...nodes.fleet.plants import Plant, free_port, until
from ..speed.tree import usage_of
from ..table import Figure, PipelineBench

AXES = 8
"""Axes of a machine."""
LOAD = "machines, routers and fleet nodes share this computer; machines are simulated reports"
_PATIENCE_S = 120.0


@dataclass(frozen=True, slots=True)
class PlantBenchSettings:
    """Extent of a run.

    Attributes:
        seconds: of reporting while routers die.
        losing_axes, losing_hz: axes of that plant, and reports of each machine per second.
        many_axes: axes of the plant that two fleet nodes share, once a second.
        window_s: in which the cost of those is counted, s.
    """

    seconds: float = 20.0
    losing_axes: int = 1000
    losing_hz: float = 10.0
    many_axes: int = 10_000
    window_s: float = 20.0


def run_plant_bench(settings: PlantBenchSettings, say: Callable[[str], None]) -> PipelineBench:
    """Measure both plants, one after the other."""
    with tempfile.TemporaryDirectory() as folder:
        figures = _losing(settings, Path(folder), say)
    with tempfile.TemporaryDirectory() as folder:
        figures += _many(settings, Path(folder), say)
    return PipelineBench(tuple(figures), (LOAD,))


def _losing(settings: PlantBenchSettings, folder: Path, say: Callable[[str], None]) -> list[Figure]:
    """Two edge routers and a plant router, of which two are killed while machines report."""
    plant = Plant(folder)
    edges = {f"edge-{k}": f"tcp/127.0.0.1:{free_port()}" for k in (1, 2)}
    each = settings.losing_axes // AXES // 2
    rounds = round(settings.seconds * settings.losing_hz)
    try:
        plant.router()
        for name, endpoint in edges.items():
            _edge_router(plant, name, endpoint)
        plant.node("fleet")
        until(lambda: plant.ask("fleet")["nodes"][0]["parts"] == 64, _PATIENCE_S)
        say(
            f"{2 * each} machines of {AXES} axes, {settings.losing_hz:g} Hz, two routers are killed"
        )
        for k, endpoint in enumerate(edges.values()):
            plant.start(
                f"machines-{k}",
                *("tests.nodes.fleet.machines", endpoint, "--machines", str(each)),
                *("--axes", str(AXES), "--period", str(1.0 / settings.losing_hz)),
                *("--rounds", str(rounds), "--prefix", f"m{k}-"),
            )
            assert plant.line(f"machines-{k}") == "reporting"
        until(lambda: plant.shows("fleet", 2 * each * AXES), _PATIENCE_S)
        before, began_s = usage_of(plant.processes["fleet"].pid), time.monotonic()
        answers: list[float] = []
        for name, again in (
            ("router", plant.router),
            ("edge-1", lambda: _edge_router(plant, "edge-1", edges["edge-1"])),
        ):
            _answered(plant, answers, settings.seconds / 6.0)
            plant.kill(name)
            _answered(plant, answers, 2.0)
            again()
            _answered(plant, answers, settings.seconds / 6.0)
        for k in range(2):
            assert plant.line(f"machines-{k}") == "done"
        total = 2 * each * rounds
        until(lambda: plant.metric("fleet", "received") >= total, _PATIENCE_S)
        spent = usage_of(plant.processes["fleet"].pid)
        cores = (spent.cpu_s - before.cpu_s) / (time.monotonic() - began_s)
        sent = sum(plant.sent(f"machines-{k}") for k in range(2))
        lost = plant.metric("fleet", "lost")
        received = plant.metric("fleet", "received")
    finally:
        _end(plant)
    axes = 2 * each * AXES
    return [
        Figure("losing_sent", f"{axes} axes: reports sent", sent, ""),
        Figure("losing_received", "reports received", received, "", at_least=float(sent)),
        Figure("losing_lost", "lost although two routers were killed", lost, "", at_most=0.0),
        Figure("losing_answer_s", "slowest answer of the fleet", max(answers), "s", at_most=1.0),
        Figure("losing_mb", "memory of the fleet node", spent.own_mb, "MB", at_most=400.0),
        Figure("losing_cores", "processor of the fleet node", cores, "cores", at_most=0.6),
    ]


def _many(settings: PlantBenchSettings, folder: Path, say: Callable[[str], None]) -> list[Figure]:
    """Many axes once a second, two fleet nodes, one of which is killed."""
    plant = Plant(folder)
    machines = settings.many_axes // AXES
    axes = machines * AXES
    names = ("one", "two")
    try:
        plant.router()
        for name in names:
            plant.node(name)
        say(f"{machines} machines of {AXES} axes once a second, one of two fleet nodes is killed")
        plant.machines("--machines", str(machines), "--axes", str(AXES), "--period", "1.0")
        until(lambda: all(plant.shows(name, axes) for name in names), _PATIENCE_S)
        pids = [plant.processes[name].pid for name in (*names, "router")]
        before, began_s = [usage_of(pid) for pid in pids], time.monotonic()
        answers: list[float] = []
        _answered(plant, answers, settings.window_s, "two")
        after = [usage_of(pid) for pid in pids]
        window_s = time.monotonic() - began_s
        cores = [(b.cpu_s - a.cpu_s) / window_s for a, b in zip(before, after, strict=True)]
        plant.kill("one")
        taken_s = until(
            lambda: plant.reads_all("two", machines) and plant.shows("two", axes), _PATIENCE_S
        )
        alone = usage_of(plant.processes["two"].pid)
        lost = plant.metric("two", "lost")
    finally:
        _end(plant)
    return [
        Figure("many_cores", f"{axes} axes: both fleet nodes", sum(cores[:2]), "cores"),
        Figure("many_axis_us", "fleet nodes, an axis a second", 1e6 * sum(cores[:2]) / axes, "us"),
        Figure("many_router_us", "router, an axis a second", 1e6 * cores[2] / axes, "us"),
        Figure(
            "many_mb", "memory of the larger node", max(each.own_mb for each in after[:2]), "MB"
        ),
        Figure("many_answer_s", "slowest answer of the fleet", max(answers), "s", at_most=1.0),
        Figure("many_lost", "lost", lost, "", at_most=0.0),
        Figure(
            "many_taken_s", "a node is killed: its share is read again", taken_s, "s", at_most=5.0
        ),
        Figure("many_alone_mb", "memory of the node that is left", alone.own_mb, "MB"),
    ]


def _edge_router(plant: Plant, name: str, endpoint: str) -> None:
    """Start a router below the plant's."""
    plant.start(
        name,
        *("edge_service", "plant", "router", "--listen", endpoint, "--connect", plant.endpoint),
    )
    assert "serving" in plant.line(name)


def _answered(plant: Plant, answers: list[float], seconds: float, node: str = "fleet") -> None:
    """Ask for the fleet twice a second for some time; adds how long each answer took, s."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        began_s = time.monotonic()
        try:
            plant.ask(node)
            answers.append(time.monotonic() - began_s)
        except (urllib.error.URLError, TimeoutError):
            answers.append(math.inf)
        time.sleep(0.5)


def _end(plant: Plant) -> None:
    for name in list(plant.processes):
        plant.kill(name, signal.SIGKILL)
