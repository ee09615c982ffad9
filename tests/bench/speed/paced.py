"""Processor time per sample of the service and of a peer, both at work in the same seconds."""

import json
import shutil
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...drivers.bench import free_port
from ..table import BenchError
from .process_meter import Program, ServiceProcess, Usage, get, usage_of, wait_until

RATE_HZ = 1000.0
MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
_KEPT_UP = 0.97  # share of the samples that are due which a service that keeps up has read at least
SERVICE = """\
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
"""
_AXIS = """
[[axes]]
name = "A{number}"
driver = "replay"
[axes.settings]
path = "{recording}"
loop = true
"""


@dataclass(frozen=True, slots=True)
class Paced:
    us_per_sample: float  # processor time of all processes of the service, us
    # that of publisher, broker and estimating process; None without a broker
    peer_us_per_sample: float | None
    usage: Usage  # of the service at the end of the window


def service(folder: Path, kernels: Path, recording: Path, axes: int) -> ServiceProcess:
    """The service with all its nodes, that follows recordings in real time."""
    tables = [_AXIS.format(number=k, recording=recording) for k in range(1, axes + 1)]
    (folder / "edge.toml").write_text(SERVICE + "".join(tables), "utf-8")
    return ServiceProcess(["run", "edge.toml"], folder, kernels)


def measure_paced(
    folder: Path,
    kernels: Path,
    recording: Path,
    axes: int,
    warm_up_s: float,
    window_s: float,
    rate_hz: float = 0.0,
) -> Paced:
    """Let the service work, a peer beside it unless a rate is given, and look over one window.

    Raises BenchError where the service does not keep up with its samples.
    """
    with ExitStack() as stack:
        ours = stack.enter_context(service(folder, kernels, recording, axes))
        address = ours.wait_for_address()
        peer = stack.enter_context(_peer(folder, axes)) if MOSQUITTO and not rate_hz else None
        read = f"{axes} axes: not all of them are read"
        wait_until(lambda: sum(map(bool, _samples(*address))) >= axes, read, 1.0)
        time.sleep(warm_up_s)
        samples = sum(_samples(*address))
        before, begun_s = usage_of(ours.pid), time.monotonic()
        peer_before = peer.look() if peer else (0.0, 0)
        time.sleep(window_s)
        after, span_s = usage_of(ours.pid), time.monotonic() - begun_s
        peer_after = peer.look() if peer else (0.0, 0)
        samples = sum(_samples(*address)) - samples
    if samples < _KEPT_UP * span_s * (rate_hz or RATE_HZ) * axes:
        raise BenchError(f"{axes} axes: the service does not keep up with their samples")
    us = 1e6 * (after.cpu_s - before.cpu_s) / samples
    count = peer_after[1] - peer_before[1]
    peers_us = 1e6 * (peer_after[0] - peer_before[0]) / count if count else None
    return Paced(us, peers_us, after)


def _samples(host: str, port: int) -> list[int]:
    """Samples read so far, of each axis."""
    parts = json.loads(get(host, port, "/api/v1/health")[1])["components"]
    return [each["counters"]["samples"] for each in parts if "samples" in each["counters"]]


class _Peer:
    def __init__(self, *programs: Program) -> None:
        self._programs = programs

    def look(self) -> tuple[float, int]:
        """Processor time of all three, s, and the samples that were estimated from."""
        self._programs[-1].tell("")
        count = int(self._programs[-1].hear())
        return sum(usage_of(each.pid).cpu_s for each in self._programs), count


@contextmanager
def _peer(folder: Path, axes: int) -> Iterator[_Peer]:
    port = free_port()
    config = folder / "mosquitto.conf"
    config.write_text(f"user root\nlistener {port} 127.0.0.1\nallow_anonymous true\n")
    line = (sys.executable, "-m", "tests.bench.speed.peer")
    with Program(str(MOSQUITTO), "-c", str(config)) as broker:
        wait_until(lambda: _is_open(port), "the peer's broker does not begin", 0.02)
        with (
            Program(*line, "publish", str(port), str(axes)) as publish,
            Program(*line, "estimate", str(port), str(axes)) as estimate,
        ):
            yield _Peer(broker, publish, estimate)


def _is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0
