"""The overview of many services: two real ones, silent ones, strange ones."""

import asyncio
import io
import json
import re
import socket
import threading
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError
from rich.console import Console

from edge_service.cli.entry import main
from edge_service.command_answer import Answer
from edge_service.config import HttpConfig, ServiceConfig
from edge_service.config_tables import FleetConfig, FleetServiceConfig, HistoryConfig
from edge_service.health.fleet.rows import FleetRow
from edge_service.health.store.store import FILE_NAME, Store
from edge_service.health.store.tokens import Tokens
from edge_service.messages.health import AxisCondition
from edge_service.offline.fleet.ask import ask_fleet
from edge_service.offline.fleet.rows import rows_of
from edge_service.offline.fleet.table import Fleet, table_of, terminal_table
from tests.certificates import write_certificates

from ..nodes.conftest import Running, config_of, running, until

NOW = datetime(2026, 1, 31, 12, 0, tzinfo=UTC)


def fleet_of(*addresses: str, timeout_s: float = 20.0) -> FleetConfig:
    return FleetConfig(
        timeout_s=timeout_s, services=[FleetServiceConfig(address=each) for each in addresses]
    )


def fleet_document(rows: Sequence[FleetRow]) -> str:
    """The rows as a program reads them."""
    return Answer("", Fleet.of(rows)).as_json()


class Service:
    """Answers as a service with one axis would that loses `loss` % of 10 % per 1000 h."""

    def __init__(self, machine: str, loss: float, condition: str = "NORMAL") -> None:
        rate = -loss / 100.0 * 10.0 / 1000.0
        error = 0.05 * abs(rate) * 1.645
        crossing = {"limit": "warning", "limit_percent": 6.0, "likely": None}
        crossing |= {"earliest": "2026-03-01T00:00:00.000Z", "latest": "2026-05-01T00:00:00.000Z"}
        interval = {"value": rate, "low": rate - error, "high": rate + error}
        trend = {"rate_percent_per_h": interval, "crossings": [crossing]}
        axis = {"axis": "X", "condition": condition}
        self.answers: dict[str, Any] = {
            "/api/v1/axes": {
                "site": "s",
                "machine": machine,
                "axes": [axis | {"limits": {"fresh_percent": 10.0}}],
            },
            "/api/v1/health": {"axes": [axis | {"alarms": [], "reasons": [], "trend": trend}]},
            "/api/v1/axes/X/preload": axis
            | {"status": "estimated", "preload_percent": 8.0, "low": 7.5, "high": 8.5}
            | {"age_s": 0.1, "reasons": []},
        }


def asked(services: dict[str, Service], address: str, left_s: float) -> Any:
    """Answers of one of the services; nobody waits."""
    assert left_s > 0.0
    host, _, path = address.partition("/api/")
    return services[host].answers[f"/api/{path}"]


async def normal(service: Running) -> str:
    """The address of a service, once its axis is NORMAL."""
    address = await service.address

    async def is_normal() -> bool:
        async with httpx.AsyncClient(base_url=address) as client:
            answer = (await client.get("/api/v1/axes/X/preload")).json()
        return bool(answer["condition"] == "NORMAL" and answer["status"] == "estimated")

    await until(is_normal)
    return address


async def test_a_service_with_tls_and_tokens_is_asked_with_its_token(tmp_path: Path) -> None:
    certificate, key = write_certificates(tmp_path)
    secret = Tokens(Store(tmp_path / "state" / FILE_NAME)).add("fleet", "viewer", 0)
    for name, content in (("token", secret), ("wrong", "edge-wrong"), ("read", secret)):
        (tmp_path / name).write_text(content)
        (tmp_path / name).chmod(0o644 if name == "read" else 0o600)
    http = HttpConfig(port=0, certificate=certificate, private_key=key)
    history = HistoryConfig(folder=tmp_path / "state")
    async with running(config_of("simulated", {}, http=http, history=history)) as service:
        place = {"address": await service.address, "ca_certificate": tmp_path / "ca.pem"}
        cases = [{"token_file": tmp_path / name} for name in ("token", "wrong", "read")]
        asked = [place | more for more in (*cases, {}, {"ca_certificate": None})]
        fleet = FleetConfig.model_validate({"services": asked})
        rows = await asyncio.to_thread(ask_fleet, fleet)
    reasons = sorted(row.reason for row in rows if row.machine == "?")
    assert [row.site for row in rows if row.machine != "?"] == ["bench"]
    assert sum("answers 401" in reason for reason in reasons) == 2
    assert sum("others may read" in reason for reason in reasons) == 1
    assert sum("CERTIFICATE_VERIFY_FAILED" in reason for reason in reasons) == 1
    assert secret not in "".join(reasons)


def test_a_token_goes_nowhere_in_clear_text() -> None:
    FleetServiceConfig(address="http://127.0.0.1:8080", token_file=Path("token"))
    with pytest.raises(ValidationError, match="needs https, or the token could be read"):
        FleetServiceConfig(address="http://192.0.2.1:8080", token_file=Path("token"))


async def test_a_token_is_shown_to_no_one_a_service_points_to(tmp_path: Path) -> None:
    seen: list[bytes] = []

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        seen.append(await reader.readuntil(b"\r\n\r\n"))
        writer.write(b"HTTP/1.1 302 Found\r\nLocation: /elsewhere\r\nContent-Length: 0\r\n\r\n")
        writer.close()

    (tmp_path / "token").write_text("edge-x")
    (tmp_path / "token").chmod(0o600)
    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    async with server:
        address = f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}"
        service = {"address": address, "token_file": tmp_path / "token"}
        fleet = FleetConfig.model_validate({"services": [service]})
        (row,) = await asyncio.to_thread(ask_fleet, fleet)
    assert "answers 302" in row.reason
    assert len(seen) == 1


async def test_two_services_and_a_silent_one_in_one_table() -> None:
    settings = {"scenario": "healthy", "speed": 20.0}
    sites = [ServiceConfig(site="north", machine="m1"), ServiceConfig(site="south", machine="m2")]
    configs = [config_of("simulated", settings, service=site) for site in sites]
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))  # taken, and nobody listens
        dead = f"http://127.0.0.1:{silent.getsockname()[1]}"
        async with running(configs[0]) as one, running(configs[1]) as two:
            addresses = [await normal(one), dead, await normal(two)]
            rows = await asyncio.to_thread(ask_fleet, fleet_of(*addresses))
    by_machine = {row.machine: row for row in rows}
    for machine, site in (("m1", "north"), ("m2", "south")):
        row = by_machine[machine]
        assert (row.site, row.axis) == (site, "X")
        assert row.condition is AxisCondition.NORMAL
        assert row.low is not None and row.high is not None and row.preload_percent is not None
        assert row.low <= row.preload_percent <= row.high
        assert row.fits is True
    lost = by_machine["?"]
    assert lost.condition is AxisCondition.UNAVAILABLE
    assert "refused" in lost.reason
    assert table_of(rows).startswith("FLEET UNAVAILABLE: 1 UNAVAILABLE, 2 NORMAL\n")
    assert dead in table_of(rows)


def test_the_axis_that_wears_faster_is_named_with_its_peers() -> None:
    losses = {f"http://h{k}": 10.0 + 0.3 * k for k in range(5)} | {"http://h9": 50.0}
    services = {address: Service(address[-2:], loss) for address, loss in losses.items()}
    rows = ask_fleet(fleet_of(*services), lambda address, left: asked(services, address, left))
    assert rows[0].machine == "h9"
    assert [row.peers is not None and row.peers.faster for row in rows] == [True, *[False] * 5]
    assert rows[0].peers is not None
    assert rows[0].peers.peers_loss == pytest.approx(10.6)  # the middle of 10, 10.3 ... 11.2
    assert rows[0].loss_percent_per_1000_h is not None
    assert rows[0].loss_percent_per_1000_h[0] == pytest.approx(50.0)
    text = table_of(rows, NOW)
    assert "s/h9/X loses 50 % of its fresh preload per 1000 h, its 5 peers 10.6 %" in text
    assert "warning 2026-03-01 to 2026-05-01" in text


def test_the_worst_comes_first() -> None:
    conditions = ("NORMAL", "UNAVAILABLE", "FAULT", "WARNING")
    services = {f"http://h{k}": Service(f"h{k}", 1.0, each) for k, each in enumerate(conditions)}
    rows = ask_fleet(fleet_of(*services), lambda address, left: asked(services, address, left))
    assert [row.condition.value for row in rows] == ["FAULT", "WARNING", "UNAVAILABLE", "NORMAL"]
    answer = json.loads(fleet_document(rows))
    assert answer["condition"] == "FAULT"
    assert answer["rows"][0]["machine"] == "h2"


@pytest.mark.parametrize(
    ("path", "answer"),
    [
        ("/api/v1/axes", []),
        ("/api/v1/axes", {"axes": 3}),
        ("/api/v1/health", {"axes": []}),
        ("/api/v1/axes/X/preload", {"axis": "X"}),
        ("/api/v1/axes/X/preload", None),
    ],
)
def test_a_strange_answer_is_reported_and_spoils_nothing(path: str, answer: object) -> None:
    services = {"http://a": Service("a", 1.0), "http://b": Service("b", 1.0)}
    services["http://b"].answers[path] = answer
    rows = ask_fleet(fleet_of(*services), lambda address, left: asked(services, address, left))
    assert [row.condition.value for row in rows] == ["UNAVAILABLE", "NORMAL"]
    assert "no answer of an edge-service" in rows[0].reason


ADVICE = {"headline": {"text": "The preload is low [17]."}, "advice": [{"text": "Plan a nut."}]}


@pytest.mark.parametrize("width", [60, 100, 200])
def test_a_terminal_shows_headline_and_first_task_at_any_width(width: int) -> None:
    low, old = Service("m1", 1.0, "WARNING"), Service("m2", 1.0)
    low.answers["/api/v1/health"]["axes"][0].update(ADVICE)
    services = {"http://a": low, "http://b": old}  # one that knows neither
    rows = ask_fleet(fleet_of(*services), lambda address, left: asked(services, address, left))
    assert (rows[0].headline, rows[0].task) == ("The preload is low [17].", "Plan a nut.")
    assert (rows[1].headline, rows[1].task) == ("", "")
    said = io.StringIO()
    Console(width=width, file=said).print(terminal_table(rows, NOW))
    text = said.getvalue()
    assert max(map(len, text.splitlines())) <= width
    words = re.findall(r"[^\s│]+", text)
    assert {"low", "[17].", "nut."} <= set(words)
    for line in (table_of(rows, NOW).splitlines()[2], fleet_document(rows)):
        assert "The preload is low [17]." in line
        assert "Plan a nut." in line


def test_a_terminal_gets_a_table_and_a_pipe_plain_lines(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for on_terminal in (True, False):
        monkeypatch.setattr("sys.stdout.isatty", lambda on=on_terminal: on)
        assert main(["fleet", "http://127.0.0.1:1"]) == 0
        text = capsys.readouterr().out
        assert text.startswith("FLEET UNAVAILABLE: 1 UNAVAILABLE\n")
        assert ("┃" in text) == on_terminal


def test_members_that_a_newer_service_adds_are_no_fault() -> None:
    service = Service("a", 1.0)
    answers = [{**answer, "more": [1]} for answer in service.answers.values()]
    (row,) = rows_of("http://a", answers[0], answers[1], [answers[2]])
    assert row.share_percent == pytest.approx(80.0)


def test_a_service_that_hangs_holds_nobody_up() -> None:
    released = threading.Event()
    services = {"http://a": Service("a", 1.0), "http://b": Service("b", 1.0)}

    def ask(address: str, left_s: float) -> Any:
        if address.startswith("http://b"):
            released.wait(60.0)
        return asked(services, address, left_s)

    begin_s = time.monotonic()
    rows = ask_fleet(fleet_of("http://a", "http://b", timeout_s=0.5), ask)
    took_s = time.monotonic() - begin_s
    released.set()
    assert took_s < 5.0
    assert [row.condition.value for row in rows] == ["UNAVAILABLE", "NORMAL"]
    assert rows[0].reason == "no answer within 0.5 s"


class _Foreign(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        if self.path.startswith("/html"):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<html>")
        else:
            self.send_error(404)

    def log_message(self, *args: object) -> None:
        """Quiet."""


def test_a_foreign_server_is_distinguished(capsys: pytest.CaptureFixture[str]) -> None:
    server = HTTPServer(("127.0.0.1", 0), _Foreign)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}"
    try:
        assert main(["fleet", address, f"{address}/html"]) == 0
    finally:
        server.shutdown()
        server.server_close()
    text = capsys.readouterr().out
    assert "/api/v1/axes answers 404" in text
    assert "/api/v1/axes answers no JSON" in text


def test_watching_goes_on_until_it_is_interrupted(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slept: list[float] = []

    def sleep(seconds: float) -> None:
        slept.append(seconds)
        if len(slept) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr("edge_service.cli.fleet.time.sleep", sleep)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        dead = f"http://127.0.0.1:{silent.getsockname()[1]}"
        assert main(["fleet", dead, "--json", "--watch", "7"]) == 130
    assert slept == [7.0, 7.0]
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["condition"] for line in lines] == ["UNAVAILABLE"] * 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "expected addresses, or --services"),
        (["ftp://x"], "no address of the form http://127.0.0.1:8080/"),
        (["http://x:port"], "no address of the form"),
        (["http://"], "no address of the form"),
        (["http://127.0.0.1:1", "--timeout", "0"], "0"),
    ],
)
def test_what_is_no_address_is_refused(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fleet", *arguments]) == 2
    seen = capsys.readouterr()
    assert seen.out == ""
    assert said in seen.err
    assert len(seen.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "services: missing"),
        ("services = []", "services"),
        ("[[services]]\naddres = 'http://a'", "services[0].address: missing"),
        ("[[services]]\naddress = 'a'", "no address of the form"),
        ("[[services]", "is not valid TOML"),
    ],
)
def test_a_fleet_file_is_checked(
    content: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "fleet.toml"
    path.write_text(content)
    assert main(["fleet", "--services", str(path)]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert str(path) in error
