"""Needs of the service by number of axes: processor, memory, disk, network.

python -m tests.bench.needs
"""

import http.client
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import click

from .faults.scene import RunningService, configuration, running_service

WARM_UP_S = 30.0
DAY_S = 86_400.0
_NAMES = "XYZABCUVW"


@dataclass(frozen=True, slots=True)
class Need:
    """Needs of one service.

    Attributes:
        cores: processor time per time, the simulated drives at 1 kHz included.
        memory_mb: resident, shared libraries included; most of it is there without any axis.
        disk_mb_per_day: growth of the history's folder, before an hour is compacted.
        page_kb_per_s: of one open page.
        metrics_kb: of one answer of `/metrics`.
    """

    axes: int
    cores: float
    memory_mb: float
    disk_mb_per_day: float
    page_kb_per_s: float
    metrics_kb: float


def needs(axes: int, seconds: float) -> Need:
    """Measure a service with a history on disk, which one page watches."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        history = folder / "history"
        config = configuration(tuple(_NAMES[:axes]), folder=history)
        with running_service(config, folder) as service:
            service.wait_ready()
            time.sleep(WARM_UP_S)
            before, size, begun_s = service.usage(), folder_bytes(history), time.monotonic()
            heard = page_bytes(service, seconds)
            after, span_s = service.usage(), time.monotonic() - begun_s
            growth = folder_bytes(history) - size
            return Need(
                axes,
                (after.cpu_s - before.cpu_s) / span_s,
                after.rss_bytes / 1e6,
                growth / span_s * DAY_S / 1e6,
                heard / span_s / 1e3,
                len(service.ask("/metrics").body) / 1e3,
            )


def folder_bytes(folder: Path) -> int:
    """Size of all files below a folder."""
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def page_bytes(service: RunningService, seconds: float) -> int:
    """Bytes of the live stream in some time."""
    connection = http.client.HTTPConnection(service.host, service.port, timeout=5.0)
    connection.request("GET", "/api/v1/events")
    response, heard = connection.getresponse(), 0
    until_s = time.monotonic() + seconds
    with suppress(TimeoutError):
        while time.monotonic() < until_s:
            heard += len(response.read1(1 << 16))
    connection.close()
    return heard


@click.command()
@click.option("--axes", multiple=True, type=int, default=(1, 2, 4, 8), show_default=True)
@click.option("--seconds", default=60.0, show_default=True)
def main(axes: tuple[int, ...], seconds: float) -> None:
    """Print a line per number of axes."""
    click.echo("axes  cores  memory MB  disk MB/day  page kB/s  metrics kB")
    for number in axes:
        need = needs(number, seconds)
        first = f"{need.axes:4d}  {need.cores:5.2f}  {need.memory_mb:9.0f}"
        rest = f"{need.disk_mb_per_day:11.0f}  {need.page_kb_per_s:9.1f}  {need.metrics_kb:10.1f}"
        click.echo(f"{first}  {rest}")


if __name__ == "__main__":
    main()
