"""Axes of many machines in one table: of routers, of services, and of what is silent or strange."""

import asyncio
import base64
import json
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings
from edge_service.cli.entry import main
from edge_service.clock import now_ns
from edge_service.messages.answer import AxesAnswer, axis_row
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import AxisHealth
from edge_service.messages.interval import Interval
from edge_service.messages.keys import MachineKeys
from edge_service.messages.topics import HEALTH
from edge_service.messages.trend import Crossing
from edge_service.offline.fleet import Fleet, FleetWatch

from ..documents import ROOT

PATIENCE_S = 120.0
LIMIT = Crossing(
    limit="fault", limit_percent=2.0, earliest_ns=10**18, likely_ns=10**18, latest_ns=None
)


@contextmanager
def router() -> Iterator[str]:
    """A Zenoh router as `deploy/` configures it, in a process of its own; yields its endpoint."""
    code = (
        "import socket, sys, zenoh\n"
        "with socket.socket() as probe:\n"
        "    probe.bind(('127.0.0.1', 0)); port = probe.getsockname()[1]\n"
        f"config = zenoh.Config.from_file({str(ROOT / 'deploy' / 'zenoh-router.json5')!r})\n"
        "config.insert_json5('listen/endpoints', f'[\"tcp/127.0.0.1:{port}\"]')\n"
        "with zenoh.open(config):\n"
        "    print(f'tcp/127.0.0.1:{port}', flush=True)\n"
        "    sys.stdin.read()\n"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    with process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.communicate()


def joining(folder: Path, endpoint: str) -> Path:
    """The machine's file of Zenoh, for a router."""
    path = folder / "zenoh.json5"
    path.write_text(f'{{ connect: {{ endpoints: {{ router: ["{endpoint}"] }} }} }}')
    return path


@asynccontextmanager
async def told(say: Callable[[], None]) -> AsyncIterator[None]:
    """A machine that goes on telling how it is."""

    async def go_on() -> None:
        while True:
            say()
            await asyncio.sleep(0.2)

    telling = asyncio.create_task(go_on())
    try:
        yield
    finally:
        telling.cancel()


async def until(watch: FleetWatch, heard: dict[str, str]) -> Fleet:
    async with asyncio.timeout(PATIENCE_S):
        while reasons(found := await asyncio.to_thread(watch.look)) != heard:
            pass
    return found


def reasons(found: Fleet) -> dict[str, str]:
    return {f"{row.machine} {row.axis}": row.reason for row in found.axes}


def health_of(axis: str, condition: AxisCondition, percent: float | None) -> AxisHealth:
    """Condition of an axis; C has a date for its next limit."""
    number = None if percent is None else Interval(value=percent, low=percent - 2, high=percent + 2)
    return AxisHealth(
        axis=axis,
        condition=condition,
        status=EstimateStatus.UNESTIMATED if number is None else EstimateStatus.ESTIMATED,
        method="mixture",
        of_fresh=number,
        measured_time_ns=now_ns(),
        since_time_ns=1,
        next_limit=LIMIT if axis == "C" else None,
    )


def healths() -> list[AxisHealth]:
    return [
        health_of("A", AxisCondition.NORMAL, 98.0),
        health_of("B", AxisCondition.WARNING, 55.0),
        health_of("C", AxisCondition.WARNING, 58.0),
        health_of("D", AxisCondition.FAULT, 12.0),
        health_of("E", AxisCondition.UNAVAILABLE, None),
    ]


async def test_the_last_word_on_each_axis_is_told_while_its_machine_goes_on(tmp_path: Path) -> None:
    with router() as endpoint:
        watch, keys = FleetWatch([endpoint]), MachineKeys("hall", "mill")
        assert await asyncio.to_thread(watch.look) == Fleet(condition=None, axes=[])
        file = joining(tmp_path, endpoint)
        bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", zenoh_file=file))
        publishers = {axis: bus.publisher(keys.key(axis, HEALTH), HEALTH, axis) for axis in "ABCDE"}

        def say() -> None:
            for health in healths():
                publishers[health.axis].publish(health, now_ns())

        heard = dict.fromkeys((f"mill {axis}" for axis in "ABCDE"), "")
        async with told(say):
            found = await until(watch, heard)
        assert [row.axis for row in found.axes] == ["D", "C", "B", "E", "A"]
        assert [row.of_fresh and row.of_fresh.value for row in found.axes] == [12, 58, 55, None, 98]
        assert {row.method for row in found.axes} == {"mixture"}
        silent = await until(watch, dict.fromkeys(heard, "nothing that can be read comes"))
        assert {row.condition for row in silent.axes} == {AxisCondition.UNAVAILABLE}
        assert {row.of_fresh for row in silent.axes} == {None}
        await bus.close()
        await until(watch, dict.fromkeys(heard, "gone from the bus"))


async def test_who_comes_from_the_plant_may_read_and_not_publish(tmp_path: Path) -> None:
    keys = MachineKeys("hall", "mill")
    with router() as endpoint:
        file = joining(tmp_path, endpoint)
        bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", zenoh_file=file))
        heard = bus.subscribe(keys.all_axes(HEALTH), HEALTH)
        own = bus.publisher(keys.key("X", HEALTH), HEALTH, "X")
        watch = FleetWatch([endpoint])

        def say() -> None:
            own.publish(health_of("X", AxisCondition.NORMAL, 98.0), now_ns())

        async with told(say):
            await until(watch, {"mill X": ""})
        stranger = await Bus.open(BusSettings(endpoint, "client"))
        forged = stranger.publisher(keys.key("X", HEALTH), HEALTH, "X")
        forged.publish(health_of("X", AxisCondition.FAULT, 5.0), now_ns())
        await stranger.close()
        own.publish(health_of("X", AxisCondition.WARNING, 55.0), now_ns())
        conditions = []
        async for _, _, health in heard:
            conditions.append(health.condition)
            if health.condition is AxisCondition.WARNING:
                break
        assert set(conditions) == {AxisCondition.NORMAL, AxisCondition.WARNING}
        await bus.close()


@contextmanager
def service(content: bytes, status: int = 200) -> Iterator[tuple[str, list[str | None]]]:
    """A service that answers this everywhere; yields its address, and the logins shown."""
    logins: list[str | None] = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            logins.append(self.headers["authorization"])
            self.send_response(status)
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_args: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}", logins
        finally:
            server.shutdown()
            thread.join()


def answer() -> bytes:
    """Answer of a service of a later version, which has further members."""
    rows = [axis_row(health, now_ns()) for health in healths()]
    axes = AxesAnswer(site="hall", machine="mill", axes=rows)
    document = json.loads(axes.model_dump_json())
    document["later"] = document["axes"][0]["later"] = 1
    return json.dumps(document).encode()


def test_services_are_asked_with_the_login_of_netrc_and_each_that_fails_is_a_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    netrc = tmp_path / "netrc"
    netrc.write_text("machine 127.0.0.1 login any password sesame\n")
    netrc.chmod(0o600)
    monkeypatch.setenv("NETRC", str(netrc))
    with (
        service(answer()) as (good, logins),
        service(b"<html>") as (strange, _),
        service(b"", 401) as (closed, _),
    ):
        status = main(["fleet", good, strange, closed, "http://127.0.0.1:9", "--json"])
    assert status == 0
    (line,) = capsys.readouterr().out.splitlines()
    found = json.loads(line)
    assert found["condition"] == "FAULT"
    assert [row["axis"] for row in found["axes"]] == ["D", "C", "B", "", "", "", "E", "A"]
    said = {row["address"]: row["reason"] for row in found["axes"]}
    assert (said[good], said[strange]) == ("", "no answer of an edge-service")
    assert said[closed] == "answers with status 401"
    assert "cannot be reached" in said["http://127.0.0.1:9"]
    assert logins == ["Basic " + base64.b64encode(b"any:sesame").decode()]


def test_a_router_that_is_away_is_a_line_of_the_table(capsys: pytest.CaptureFixture[str]) -> None:
    with service(answer()) as (good, _):
        assert main(["fleet", "tcp/127.0.0.1:9", good]) == 0
    text = capsys.readouterr().out
    assert text.startswith("FAULT: 1 FAULT, 2 WARNING, 2 UNAVAILABLE, 1 NORMAL\n")
    assert "tcp/127.0.0.1:9" in text
    assert "no Zenoh router answers" in text
    assert "fault not before 2001-09-09 01:46Z" in text


def test_watching_prints_a_line_a_round(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rounds = iter(range(2))

    def pause(_seconds: float) -> None:
        if next(rounds, None) is None:
            raise KeyboardInterrupt

    monkeypatch.setattr("edge_service.cli.service.time.sleep", pause)
    with service(answer()) as (good, _):
        assert main(["fleet", good, "--watch", "1", "--json"]) == 130
    assert [len(json.loads(e)["axes"]) for e in capsys.readouterr().out.splitlines()] == [5] * 3


@pytest.mark.parametrize("address", ["mill-1", "ftp://mill-1", "tcp/mill-1", "udp/mill-1:7447"])
def test_what_is_no_address_is_told(address: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fleet", address]) == 2
    assert f"{address!r}: expected http://HOST:PORT" in capsys.readouterr().err
