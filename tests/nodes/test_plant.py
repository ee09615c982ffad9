"""A service that reports to a plant, over a router in a process of its own that is killed."""

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh import ext

from edge_service import __version__
from edge_service.bus.plant.router import open_router
from edge_service.bus.plant.session import PlantSession, PlantSettings
from edge_service.bus.questions import MOST_BYTES, ask
from edge_service.bus.settings import TlsSettings
from edge_service.certificates import make_certificates
from edge_service.config import ConfigError, HistoryConfig, load_config
from edge_service.config_tables import PlantConfig
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition, ComponentHealth, ComponentStatus
from edge_service.messages.plant import (
    REPORT,
    LogAnswer,
    LogQuestion,
    MachineReport,
    PlantKeys,
    bucket_reports,
)
from edge_service.messages.topics import STATUS
from edge_service.nodes.outputs.plant.access import plant_settings

from ..drivers.bench import free_port
from .conftest import PIPELINE, Running, config_of, running, until

NODES = ("plant", *(name for name in PIPELINE if name != "http"))
ROUTER = """
import sys
from edge_service.bus.plant.router import open_router
router = open_router([sys.argv[1]])
print("ready", flush=True)
sys.stdin.read()
router.close()
"""
KEYS = PlantKeys("bench", "lfd")
PROMPT_S = 10.0


class Router:
    """A router in a process of its own."""

    def __init__(self, endpoint: str) -> None:
        self._endpoint = endpoint
        self._process: asyncio.subprocess.Process | None = None

    async def start(self) -> None:
        pipe = asyncio.subprocess.PIPE
        command = (sys.executable, "-c", ROUTER, self._endpoint)
        self._process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe)
        assert self._process.stdout is not None
        async with asyncio.timeout(30.0):
            assert await self._process.stdout.readline() == b"ready\n"

    async def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            await self._process.wait()
            self._process = None


@asynccontextmanager
async def router_at(endpoint: str) -> AsyncIterator[Router]:
    router = Router(endpoint)
    try:
        yield router
    finally:
        await router.kill()


class Reader:
    """Whoever reads the reports of a part of the plant."""

    def __init__(self, session: PlantSession) -> None:
        self.session = session
        self.heard: list[tuple[Header, MachineReport]] = []
        self._subscriber = ext.declare_advanced_subscriber(
            session.zenoh,
            bucket_reports(KEYS.bucket),
            self._take,
            history=ext.HistoryConfig(max_samples=1),
            recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        )

    def _take(self, sample: zenoh.Sample) -> None:
        assert str(sample.key_expr) == KEYS.report
        _, header, report = REPORT.decode(sample.payload.to_bytes())
        self.heard.append((header, report))

    @property
    def newest(self) -> MachineReport | None:
        return self.heard[-1][1] if self.heard else None

    async def asked(self, question: bytes) -> bytes | None:
        return await ask(self.session.zenoh, KEYS.log, question, 5.0)


@asynccontextmanager
async def reader_at(endpoint: str) -> AsyncIterator[Reader]:
    session = await PlantSession.open(PlantSettings(endpoint))
    try:
        yield Reader(session)
    finally:
        await session.close()


class Reports:
    """The newest report of the node on itself."""

    def __init__(self, service: Running, config: Any) -> None:
        keys = config.keys.component("plant", None, STATUS)
        self._reports = service.bus.subscribe(keys, STATUS)
        self.newest: ComponentHealth | None = None
        self._task = asyncio.create_task(self._follow())

    async def _follow(self) -> None:
        async for _, _, report in self._reports:
            self.newest = report

    async def until(self, holds: Callable[[ComponentHealth], bool]) -> ComponentHealth:
        async def held() -> ComponentHealth | None:
            newest = self.newest
            return newest if newest is not None and holds(newest) else None

        return await until(held)

    def stop(self) -> None:
        self._task.cancel()


async def so(holds: Callable[[], Any]) -> Any:
    async def held() -> Any:
        return holds()

    return await until(held)


@pytest.mark.slow
async def test_nothing_is_lost_while_the_router_is_killed_and_started_again(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    plant = PlantConfig(endpoint=endpoint, period_s=0.1, log_period_s=1.0, page="http://box/")
    history = HistoryConfig(folder=tmp_path)
    config = config_of("simulated", {}, plant=plant, history=history)
    async with router_at(endpoint) as router, running(config, NODES) as service:
        said = Reports(service, config)
        away = await said.until(lambda own: own.status is ComponentStatus.RECOVERABLE_ERROR)
        assert f"no router answers at {endpoint}" in away.reason
        assert away.readings["connected"] == 0.0
        await said.until(lambda own: own.counters["logged"] >= 2)
        await router.start()
        await said.until(lambda own: own.status is ComponentStatus.OK)
        async with reader_at(endpoint) as reader:
            await so(lambda: _is_normal(reader.newest))
            await router.kill()
            lost = await said.until(lambda own: own.readings["connected"] == 0.0)
            missed = lost.counters["reports"] + 20
            await said.until(lambda own: own.counters["reports"] >= missed)
            first, count = reader.heard[0][0].sequence, len(reader.heard)
            assert first + count < missed
            await router.start()
            await so(lambda: reader.heard[-1][0].sequence > missed + 5)
            _check_complete(reader.heard)
            await _check_log(reader)
            await _check_hostile(reader, said)
        await router.kill()
        said.stop()
        stopped_s = asyncio.get_running_loop().time()
    assert asyncio.get_running_loop().time() - stopped_s < PROMPT_S


def _is_normal(report: MachineReport | None) -> bool:
    if report is None:
        return False
    (axis,) = report.axes
    return axis.condition is AxisCondition.NORMAL and axis.status is EstimateStatus.ESTIMATED


def _check_complete(heard: list[tuple[Header, MachineReport]]) -> None:
    """Numbers are consecutive, of one publisher, and times never go back."""
    first, _ = heard[0]
    assert [header.sequence for header, _ in heard] == list(
        range(first.sequence, first.sequence + len(heard))
    )
    assert {header.boot_epoch for header, _ in heard} == {first.boot_epoch}
    times = [report.time_ns for _, report in heard]
    assert times == sorted(times)
    _, report = heard[-1]
    assert (report.site, report.machine, report.version) == ("bench", "lfd", __version__)
    assert (report.page, report.period_s) == ("http://box/", 0.1)
    (axis,) = report.axes
    assert axis.axis == "X"
    assert axis.time_ns is not None and abs(report.time_ns - axis.time_ns) < 60e9


async def _check_log(reader: Reader) -> None:
    assert reader.newest is not None and reader.newest.log is not None
    state, found = reader.newest.log, []
    while len(found) < state.last:
        after = found[-1].number if found else 0
        question = LogQuestion(log=state.log, after=after, most=2)
        said = await reader.asked(question.model_dump_json().encode())
        assert said is not None
        answer = LogAnswer.model_validate_json(said, strict=True)
        assert answer.log == state.log
        assert 1 <= len(answer.reports) <= 2
        found += answer.reports
    assert [each.number for each in found] == list(range(1, len(found) + 1))
    conditions = [each.report.axes[0].condition for each in found]
    assert conditions[0] is AxisCondition.UNAVAILABLE
    assert AxisCondition.NORMAL in conditions
    times = [each.report.time_ns for each in found]
    assert times == sorted(times)


async def _check_hostile(reader: Reader, said: Reports) -> None:
    assert said.newest is not None and reader.newest is not None and reader.newest.log is not None
    before, name = said.newest.counters["log_refused"], reader.newest.log.log
    good = {"log": name, "after": 0, "most": 1}
    for question in (
        b"x" * (MOST_BYTES + 1),
        b"\xff garbage",
        json.dumps(good | {"after": -1}).encode(),
        json.dumps(good | {"most": 10**9}).encode(),
    ):
        assert await reader.asked(question) is None
    other = await reader.asked(json.dumps(good | {"log": "another"}).encode())
    assert other is not None
    assert LogAnswer.model_validate_json(other) == LogAnswer(log=name, reports=())
    own = await said.until(lambda own: own.counters["log_refused"] >= before + 5)
    assert own.counters["log_refused"] == before + 5
    assert await reader.asked(json.dumps(good).encode()) is not None


async def test_a_service_whose_plant_never_answered_ends_at_once() -> None:
    plant = PlantConfig(endpoint=f"tcp/127.0.0.1:{free_port()}")
    config = config_of("simulated", {}, plant=plant)
    async with running(config, ("plant",)) as service:
        said = Reports(service, config)
        await said.until(lambda own: own.status is ComponentStatus.RECOVERABLE_ERROR)
        said.stop()
        stopped_s = asyncio.get_running_loop().time()
    assert asyncio.get_running_loop().time() - stopped_s < PROMPT_S


async def test_without_a_history_folder_there_is_no_log(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = config_of("simulated", {}, plant=PlantConfig(endpoint=endpoint, period_s=0.1))
    async with router_at(endpoint) as router:
        await router.start()
        async with reader_at(endpoint) as reader, running(config, ("plant",)):
            await so(lambda: reader.newest)
            assert reader.newest is not None
            assert reader.newest.log is None
            assert reader.newest.axes[0].condition is AxisCondition.UNAVAILABLE
            assert await reader.asked(b'{"log": "", "after": 0, "most": 1}') is None


async def test_a_flood_of_questions_is_refused_and_then_one_is_answered(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    plant = PlantConfig(endpoint=endpoint, period_s=0.1)
    config = config_of("simulated", {}, plant=plant, history=HistoryConfig(folder=tmp_path))
    question = json.dumps({"log": "another", "after": 0, "most": 1}).encode()
    async with router_at(endpoint) as router:
        await router.start()
        async with reader_at(endpoint) as reader, running(config, ("plant",)) as service:
            said = Reports(service, config)
            await said.until(lambda own: own.counters["logged"] >= 1)
            await so(lambda: reader.newest)
            answers = await asyncio.gather(*(reader.asked(question) for _ in range(2000)))
            assert sum(each is not None for each in answers) < 200
            own = await said.until(lambda own: own.counters["log_refused"] >= 2000)
            assert own.counters["log_refused"] == 2000
            assert await reader.asked(question) is not None
            said.stop()


async def test_reports_go_by_mutual_tls_and_a_router_of_others_is_not_trusted(
    tmp_path: Path,
) -> None:
    for folder in ("ours", "theirs"):
        make_certificates(tmp_path / folder, (), {"plant": "plant.node.edge-service"}, 1)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    path = configured(tmp_path / "ours", f'endpoint = "{endpoint}"\nperiod_s = 0.1\n{FILES}')
    plant = load_config(path).plant
    assert plant is not None
    config = config_of("simulated", {}, plant=plant)

    def router_of(folder: str) -> zenoh.Session:
        return open_router([endpoint], [], TlsSettings.of_folder("", tmp_path / folder, "server"))

    router = await asyncio.to_thread(router_of, "theirs")
    async with running(config, ("plant",)) as service:
        said = Reports(service, config)
        away = await said.until(lambda own: own.status is ComponentStatus.RECOVERABLE_ERROR)
        assert "or none that trusts this certificate" in away.reason
        router.close()
        router = await asyncio.to_thread(router_of, "ours")
        await said.until(lambda own: own.status is ComponentStatus.OK)
        session = await PlantSession.open(plant_settings(plant))
        reader = Reader(session)
        await so(lambda: reader.newest)
        await session.close()
        said.stop()
    router.close()


# configuration

AXES = '[[axes]]\nname = "X"\n'


def configured(folder: Path, plant: str) -> Path:
    path = folder / "edge.toml"
    path.write_text(f"[plant]\n{plant}\n{AXES}")
    path.chmod(0o600)
    return path


@pytest.mark.parametrize(
    ("plant", "complaint"),
    [
        ("period_s = 1.0", "plant.endpoint: "),
        ('endpoint = "nonsense"', "plant: 'nonsense' is not an endpoint"),
        ('endpoint = "tcp/192.0.2.1:7447"', "plant: 'tcp/192.0.2.1:7447' leaves this machine"),
        ('endpoint = "tls/192.0.2.1:7447"', "plant: 'tls/192.0.2.1:7447' needs ca_certificate"),
        (
            'endpoint = "tls/router:7447"\nca_certificate = "ca.pem"',
            "plant: client_certificate: missing",
        ),
        ('endpoint = "tcp/127.0.0.1:7447"\npage = "box"', "plant.page: "),
        ('endpoint = "tcp/127.0.0.1:7447"\nperiod_s = 0.0', "plant.period_s: "),
        ('endpoint = "tcp/127.0.0.1:7447"\nlog_mb = 0', "plant.log_mb: "),
        ('endpoint = "tcp/127.0.0.1:7447"\nsite = "s"', "plant.site: "),
    ],
)
def test_what_is_wrong_is_told_in_a_line(plant: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]*$") as caught:
        load_config(configured(tmp_path, plant))
    assert complaint in str(caught.value)


FILES = 'ca_certificate = "ca.pem"\nclient_certificate = "plant.pem"\nclient_key = "plant.key"'


def test_files_are_those_beside_the_configuration_and_must_be_usable(tmp_path: Path) -> None:
    path = configured(tmp_path, f'endpoint = "tls/router.plant:7447"\n{FILES}')
    plant = load_config(path).plant
    assert plant is not None
    with pytest.raises(ConfigError, match=r"^plant\.ca_certificate: [^\n]*cannot be used"):
        plant_settings(plant)
    make_certificates(tmp_path, (), {"plant": "plant.node.edge-service"}, 1)
    settings = plant_settings(plant)
    assert settings.certificates is not None
    assert settings.certificates.key == tmp_path / "plant.key"


def test_whoever_says_so_may_report_unencrypted(tmp_path: Path) -> None:
    path = configured(tmp_path, 'endpoint = "tcp/192.0.2.1:7447"\nallow_plain = true')
    plant = load_config(path).plant
    assert plant is not None
    assert plant_settings(plant).certificates is None
