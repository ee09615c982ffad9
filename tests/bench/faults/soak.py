"""Soak: axes at 1 kHz with history on disk and live readers; does anything grow?

python -m tests.bench.faults.soak --minutes 60
"""

import http.client
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np

from ..table import Figure, PipelineBench
from .scene import RunningService, configuration, running_service

READERS = 5
_PERIOD_S = 5.0
_WARM_UP_SHARE = 0.25
_BYTES_PER_MB = 1e6
MOST_MEMORY_MB, MOST_GROWTH_MB_PER_H = 300.0, 1.0


@dataclass(frozen=True, slots=True)
class Look:
    """State of the service at one moment."""

    time_s: float
    rss_bytes: int
    descriptors: int
    threads: int
    unestimated: int


def look(service: RunningService, axes: tuple[str, ...], begun_s: float) -> Look:
    """Measure, and ask for the preload of every axis, its history, and the metrics."""
    answers = [service.ask(f"/api/v1/axes/{axis}/preload").json for axis in axes]
    for path in ("/metrics", *(f"/api/v1/axes/{axis}/history" for axis in axes)):
        service.ask(path)
    return Look(
        time.monotonic() - begun_s,
        service.usage().rss_bytes,
        service.descriptors(),
        service.threads(),
        sum(answer["status"] != "estimated" for answer in answers),
    )


@contextmanager
def live_readers(service: RunningService, number: int) -> Iterator[None]:
    """Readers of the live stream, for as long as the context lasts."""
    stop = threading.Event()
    threads = [
        threading.Thread(target=_read, args=(service, stop), daemon=True) for _ in range(number)
    ]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


def _read(service: RunningService, stop: threading.Event) -> None:
    connection = http.client.HTTPConnection(service.host, service.port, timeout=5.0)
    with suppress(OSError, http.client.HTTPException):
        connection.request("GET", "/api/v1/events")
        response = connection.getresponse()
        while not stop.is_set() and response.read1(1 << 16):
            pass
    connection.close()


def slope_per_h(looks: list[Look], name: str) -> float:
    """Growth of one reading after the warm-up, per hour, by least squares."""
    settled = looks[round(_WARM_UP_SHARE * len(looks)) :]
    hours = [each.time_s / 3600.0 for each in settled]
    return float(np.polyfit(hours, [float(getattr(each, name)) for each in settled], 1)[0])


def soak(folder: Path, axes: int, minutes: float, period_s: float = _PERIOD_S) -> PipelineBench:
    """Run a service for a while, and see what grows."""
    names = tuple(f"A{number}" for number in range(1, axes + 1))
    looks: list[Look] = []
    with running_service(configuration(names, folder=folder / "history"), folder) as service:
        service.wait_ready()
        begun_s, before = time.monotonic(), service.usage().cpu_s
        with live_readers(service, READERS):
            while time.monotonic() - begun_s < 60.0 * minutes:
                looks.append(look(service, names, begun_s))
                time.sleep(period_s)
        used = service.usage()
        elapsed_s = time.monotonic() - begun_s
    settled = looks[round(_WARM_UP_SHARE * len(looks)) :]
    memory_mb = used.peak_rss_bytes / _BYTES_PER_MB
    growth_mb = slope_per_h(looks, "rss_bytes") / _BYTES_PER_MB
    descriptors, threads = slope_per_h(looks, "descriptors"), slope_per_h(looks, "threads")
    without = sum(each.unestimated for each in settled)
    figures = (
        Figure("minutes", "soak: length", elapsed_s / 60.0, "min"),
        Figure("cores", "processor", (used.cpu_s - before) / elapsed_s, "cores"),
        Figure("peak_mb", "peak memory", memory_mb, "MB", at_most=MOST_MEMORY_MB),
        Figure("growth_mb", "growth of memory", growth_mb, "MB/h", at_most=MOST_GROWTH_MB_PER_H),
        Figure("descriptors", "growth of descriptors", descriptors, "1/h", at_most=1.0),
        Figure("threads", "growth of threads", threads, "1/h", at_most=1.0),
        Figure("without", "answers without a number", float(without), "", at_most=0.0),
    )
    note = f"{axes} axes at 1 kHz, history on disk, {READERS} live readers, growth by least squares"
    return PipelineBench(figures, (f"{note} after the first quarter",))


@click.command()
@click.option("--axes", type=click.IntRange(1), default=8, show_default=True)
@click.option("--minutes", type=click.FloatRange(0.1), default=60.0, show_default=True)
def main(axes: int, minutes: float) -> None:
    """Print what grows in a service that runs for a while."""
    with tempfile.TemporaryDirectory() as folder:
        click.echo(soak(Path(folder), axes, minutes).as_text())


if __name__ == "__main__":
    main()
