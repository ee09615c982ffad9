"""Nothing is left to compile when the first sample comes, and a service says that it compiles."""

import asyncio
import sys
import threading
from pathlib import Path
from unittest.mock import AsyncMock

import numba
import pytest

from edge_service.config import EstimatorConfig, load_machine
from edge_service.estimate.interface import PreloadEstimator
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.health import Task
from edge_service.messages.topics import HEALTH
from edge_service.nodes import stages
from tests.programs import printed, ran

from .conftest import PATIENCE_S, config_of, running

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", ["machine", "commissioned", "emps", "cnc_mill"])
def test_the_estimators_have_answered(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An estimator that is still learning returns early, and its answers' kernels stay unused."""
    warmed: list[PreloadEstimator] = []
    make = stages.make_estimator

    def noted(*args: object) -> PreloadEstimator:
        warmed.append(make(*args))  # type: ignore[arg-type]
        return warmed[-1]

    monkeypatch.setattr(stages, "make_estimator", noted)
    stages.warm_up(EstimatorConfig(), [load_machine(ROOT / "deploy" / f"{name}.toml")])
    (estimator,) = warmed
    assert estimator.estimate().status is EstimateStatus.ESTIMATED


AFTER_WARMING_UP = """
import asyncio, sys
from drivers.base import DriverContext
from drivers.simulated import SimulatedConfig, SimulatedDriver
from edge_service.config import DEFAULT_MACHINE, EstimatorConfig, load_machine
from numba.core.event import install_recorder
from edge_service.nodes import stages

machine = load_machine(DEFAULT_MACHINE.with_name("commissioned.toml"))

async def produced():
    drive = SimulatedDriver(SimulatedConfig(speed=0.0), DriverContext("X", machine))
    await drive.open()
    frames = drive.frames()
    return [await anext(frames) for _ in range(120)]

frames = asyncio.run(produced())
stages.warm_up(EstimatorConfig(), [machine])
downsampler, estimator = (
    stages.make_downsampler(machine), stages.make_estimator(EstimatorConfig(), machine)
)
with install_recorder("numba:compile") as late:
    for frame in frames:
        for block in downsampler.push(frame):
            estimator.update(block)
            estimator.estimate()
loaded = {"scipy.constants", "scipy.linalg", "scipy.special", "pyarrow"} & {*sys.modules}
print(len(late.buffer), estimator.estimate().status, *loaded)
"""


@pytest.mark.slow
def test_production_needs_no_kernel_that_was_not_warmed_up() -> None:
    """Twelve seconds of both encoders: the event loop would stand still while one is compiled."""
    run = ran(sys.executable, "-c", AFTER_WARMING_UP, folder=ROOT)
    assert (run.stdout, run.stderr) == ("0 estimated\n", "")


async def test_the_condition_waits_for_the_estimator(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = threading.Event()
    monkeypatch.setattr(stages, "warm_up", lambda *_args: compiled.wait(PATIENCE_S))
    config = config_of("simulated", {})
    try:
        async with running(config, ("health", "estimate")) as service:
            heard = service.bus.subscribe(config.keys.all_axes(HEALTH), HEALTH)
            async with asyncio.timeout(PATIENCE_S):
                seen = []
                async for _, _, health in heard:
                    seen.append(health.reasons[0])
                    if seen[-1] == f"preparing: {stages.PREPARING}":
                        assert [each.task for each in health.advice] == [Task.WAIT]
                        compiled.set()
                    elif compiled.is_set():
                        break
            assert seen[-1].startswith("no_input")
    finally:
        compiled.set()


async def test_kernels_are_compiled_once_in_a_process_that_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Or by the set-up, which leaves nothing to compile for the first run."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(stages, "finished", finished := AsyncMock(return_value=(1, "")))
    config = config_of("simulated", {}).of_file(tmp_path / "edge.toml")
    machines = tuple(stages.load_machines(config).values())
    await stages.prepare(config, machines)
    await stages.prepare(config, machines)
    assert finished.await_count == 1
    other = config.model_copy(update={"estimator": EstimatorConfig(engine="filterpy")})
    stages.warm_up(other.estimator, machines)
    await stages.prepare(other, machines)
    assert finished.await_count == 1


HEAVY = (
    *("scipy.signal", "scipy.linalg", "scipy.stats", "scipy.special", "pyarrow", "matplotlib"),
    *("filterpy", "httpx", "rich", "pymodbus", "asyncua", "aiomqtt", "google.protobuf", "mcap"),
    *("jinja2", "tomlkit", "edge_service.diagnose", "edge_service.offline"),
    "edge_service.fingerprint",
)


@pytest.mark.slow
def test_the_nodes_load_no_library_before_it_is_needed() -> None:
    code = (
        "import sys; import edge_service.cli.entry, edge_service.nodes.service;"
        "from drivers.base import load_driver; load_driver('simulated');"
        "from edge_service import config; from edge_service.nodes.stages import warm_up;"
        "file = config.DEFAULT_MACHINE.with_name('commissioned.toml');"
        "warm_up(config.EstimatorConfig(), [config.load_machine(file)]);"
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    assert printed(sys.executable, "-c", code).strip() == "[]"
