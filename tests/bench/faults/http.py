"""A service under hostile requests, endless bodies and slow clients; do others get their answers?

python -m tests.bench.faults.http --requests 20000
"""

import asyncio
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from socket import create_connection

import click

from ..table import Figure, PipelineBench
from .hostile_requests import HostileRequest, hostile_requests
from .scene import RunningService, configuration, running_service

MOST_GROWTH_MB, LONGEST_ANSWER_S = 64.0, 1.0
SILENT, READERS, BODY_BYTES = 300, 70, 300_000_000
DELIBERATE = (b"503", b"507")
_AT_ONCE, _PATIENCE_S, _SETTLE_S = 20, 40.0, 20.0
_BYTES_PER_MB = 1e6
_CHUNK = b"a" * 1_000_000
_BODIES = {
    "POST /api/v1/jobs": "application/json",
    "POST /api/v1/axes/X/commands": "application/json",
    "PUT /api/v1/recordings/big.csv": "text/csv",
    "GET /api/v1/axes": "text/plain",
}


@dataclass(slots=True)
class Others:
    """Service to a client that meanwhile does nothing wrong."""

    answers: int = 0
    refused: int = 0
    slowest_s: float = 0.0
    stop: threading.Event = field(default_factory=threading.Event)

    def ask(self, service: RunningService) -> None:
        """Ask for the preload until it is stopped."""
        while not self.stop.wait(0.1):
            begun_s = time.monotonic()
            try:
                right = service.ask("/api/v1/axes/X/preload", timeout_s=_PATIENCE_S).status == 200
            except OSError:
                right = False
            self.slowest_s = max(self.slowest_s, time.monotonic() - begun_s)
            self.answers += right
            self.refused += not right


@contextmanager
def others(service: RunningService) -> Iterator[Others]:
    """A client that does nothing wrong, for as long as the context lasts."""
    found = Others()
    thread = threading.Thread(target=found.ask, args=(service,), daemon=True)
    thread.start()
    try:
        yield found
    finally:
        found.stop.set()
        thread.join()


async def statuses(
    service: RunningService, requests: Iterator[HostileRequest]
) -> Counter[tuple[bytes, str]]:
    """Statuses of all requests, some at once, with the method and path of those that failed."""
    seen: Counter[tuple[bytes, str]] = Counter()

    async def worker() -> None:
        for request in requests:
            status = await _status(service, request)
            failed = status[:1] == b"5" and status not in DELIBERATE
            seen[status, f"{request.method} {request.target[:80]}" if failed else ""] += 1

    await asyncio.gather(*(worker() for _ in range(_AT_ONCE)))
    return seen


async def _status(service: RunningService, request: HostileRequest) -> bytes:
    try:
        async with asyncio.timeout(_PATIENCE_S):
            reader, writer = await asyncio.open_connection(service.host, service.port)
            try:
                writer.write(request.raw(service.host))
                return (await reader.read(4096))[9:12]
            finally:
                writer.close()
    except TimeoutError:
        return b"none"
    except OSError:
        return b"gone"


def send_bodies(service: RunningService) -> int:
    """Send a body that is far too long to each kind of route; how many went unrefused."""
    return sum(not _refused(service, route, kind) for route, kind in _BODIES.items())


def _refused(service: RunningService, route: str, kind: str) -> bool:
    method, path = route.split()
    length = 10 * BODY_BYTES if method == "GET" else BODY_BYTES + 1
    head = f"{method} {path} HTTP/1.1\r\nHost: {service.host}\r\nContent-Type: {kind}\r\n"
    with create_connection((service.host, service.port), timeout=_PATIENCE_S) as connection:
        connection.sendall(f"{head}Content-Length: {length}\r\n\r\n".encode())
        with suppress(OSError):
            for _ in range(BODY_BYTES // len(_CHUNK)):
                connection.sendall(_CHUNK)
        with suppress(OSError):
            return connection.recv(100)[9:12] == b"413"
    return False


def hold_connections(service: RunningService) -> int:
    """Hold silent, half-said and unread connections; how many the service still has afterwards."""
    before = service.descriptors()
    stream = f"GET /api/v1/events HTTP/1.1\r\nHost: {service.host}\r\n\r\n".encode()
    with ExitStack() as held:
        for number in range(SILENT + READERS):
            connection = create_connection((service.host, service.port), timeout=_PATIENCE_S)
            held.enter_context(connection)
            said = stream if number >= SILENT else (b"", b"GET / HT")[number % 2]
            with suppress(OSError):
                connection.sendall(said)
        time.sleep(_SETTLE_S)
        return max(service.descriptors() - before - READERS, 0)


def attack(folder: Path, requests: int, seed: int) -> PipelineBench:
    """Attack a service in every way, one after another."""
    with running_service(configuration(folder=folder / "history"), folder) as service:
        service.wait_ready()
        service.ask("/api/v1/axes/X/history.parquet")  # loads a library of 50 MB, once
        time.sleep(_SETTLE_S)
        before, descriptors = service.usage(), service.descriptors()
        hostile = hostile_requests(service.ask("/openapi.json").json, seed)
        with others(service) as served:
            seen = asyncio.run(statuses(service, islice(hostile, requests)))
            unrefused = send_bodies(service)
            held = hold_connections(service)
        time.sleep(_SETTLE_S)
        growth_mb = (service.usage().peak_rss_bytes - before.rss_bytes) / _BYTES_PER_MB
        left = service.descriptors() - descriptors
    failed = [f"{status.decode()} {request}" for (status, request) in seen if request]
    unanswered = sum(n for (status, _), n in seen.items() if status in (b"none", b"gone", b""))
    figures = (
        Figure("requests", "hostile requests", float(seen.total()), ""),
        Figure("failures", "answered by a failure", float(len(failed)), "", at_most=0.0),
        Figure("unanswered", "without an answer", float(unanswered), ""),
        Figure("unrefused", "long bodies not refused", float(unrefused), "", at_most=0.0),
        Figure("held", "silent connections kept", float(held), "", at_most=0.0),
        Figure("growth_mb", "memory", growth_mb, "MB", at_most=MOST_GROWTH_MB),
        Figure("left", "descriptors left open", float(left), "", at_most=2.0),
        Figure("answers", "answers to others", float(served.answers), ""),
        Figure("refused", "others refused", float(served.refused), "", at_most=0.0),
        Figure("slowest_s", "slowest of them", served.slowest_s, "s", at_most=LONGEST_ANSWER_S),
    )
    counted = Counter(status.decode("latin-1") or "closed" for status, _ in seen.elements())
    by_status = ", ".join(f"{status} x {number}" for status, number in sorted(counted.items()))
    return PipelineBench(figures, (f"statuses: {by_status}", *failed[:10]))


@click.command()
@click.option("--requests", type=click.IntRange(1), default=20_000, show_default=True)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
def main(requests: int, seed: int) -> None:
    """Print how a service and its other clients fare under attack."""
    with tempfile.TemporaryDirectory() as folder:
        click.echo(attack(Path(folder), requests, seed).as_text())


if __name__ == "__main__":
    main()
