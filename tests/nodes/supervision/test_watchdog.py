"""What systemd hears: ready once, how it goes, stopping, and signs of life while all is well."""

import asyncio
import socket
from pathlib import Path

import pytest

from edge_service.nodes.supervision.watchdog import Watchdog

from ..conftest import config_of, running


def listener(address: str | bytes) -> socket.socket:
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(address)
    heard.setblocking(False)
    return heard


def lines(heard: socket.socket) -> list[str]:
    said = []
    while True:
        try:
            said.append(heard.recv(4096).decode())
        except BlockingIOError:
            return said


@pytest.mark.parametrize("abstract", [False, True])
def test_words_go_where_the_environment_says(tmp_path: Path, abstract: bool) -> None:
    name = f"edge-service-{tmp_path.name}-{id(tmp_path)}"
    address = f"@{name}" if abstract else str(tmp_path / "notify")
    with listener(f"\0{name}" if abstract else address) as heard:
        watchdog = Watchdog.of_environment({"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "4000000"})
        watchdog.look(0.0, ready=False, well=True, status="starts")
        watchdog.look(0.5, ready=True, well=True, status="starts")
        watchdog.look(1.0, ready=True, well=True, status="x" * 1000)
        watchdog.look(9.0, ready=True, well=False, status="x" * 1000)
        watchdog.stopping()
        assert lines(heard) == [
            "STATUS=starts",
            "WATCHDOG=1",
            "READY=1",
            f"STATUS={'x' * 200}",
            "WATCHDOG=1",
            "STOPPING=1",
        ]


@pytest.mark.parametrize(
    "environment",
    [
        {},
        {"NOTIFY_SOCKET": "nowhere", "WATCHDOG_USEC": "1000000"},
        {"NOTIFY_SOCKET": "/not/there", "WATCHDOG_USEC": "nonsense"},
        {"NOTIFY_SOCKET": "/not/there", "WATCHDOG_USEC": "0"},
        {"NOTIFY_SOCKET": "/not/there", "WATCHDOG_USEC": "1000000", "WATCHDOG_PID": "1"},
    ],
)
def test_nobody_who_listens_is_no_fault(environment: dict[str, str]) -> None:
    watchdog = Watchdog.of_environment(environment)
    watchdog.look(0.0, ready=True, well=True, status="fine")
    watchdog.stopping()


async def test_a_service_is_ready_when_it_serves_and_says_when_it_stops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with listener(str(tmp_path / "notify")) as heard:
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "4000000")
        async with running(config_of("simulated", {"scenario": "healthy"})) as service:
            said = lines(heard)
            await asyncio.wait_for(service.address, 30.0)
            async with asyncio.timeout(30.0):
                while "READY=1" not in said:
                    await asyncio.sleep(0.01)
                    said += lines(heard)
        assert "WATCHDOG=1" in said
        assert lines(heard)[-1] == "STOPPING=1"
