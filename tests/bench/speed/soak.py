"""Soak: axes at 1 kHz with history on disk and live readers; does anything grow?"""

import http.client
import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..table import Figure
from .paced import SERVICE
from .process_meter import PATIENCE_S, ServiceProcess, cpu_s, get, usage_of, wait_until

AXES, READERS = 8, 5
_PERIOD_S, _TIMEOUT_S = 5.0, 10.0
_WARM_UP_SHARE = 0.25
_CHECKOUT = Path(__file__).parents[3]
_AXIS = """
[[axes]]
name = "A{number}"
machine = "{machine}"
driver = "simulated"
[axes.settings]
scenario = "healthy"
seed = {number}
"""


def soak(folder: Path, kernels: Path, minutes: float) -> list[Figure]:
    """Run a service for a while, and see what grows."""
    machine = _CHECKOUT / "deploy" / "commissioned.toml"
    axes = [_AXIS.format(number=k, machine=machine) for k in range(1, AXES + 1)]
    store = f'[store]\nfolder = "{folder / "history"}"\n'
    (folder / "edge.toml").write_text(SERVICE + store + "".join(axes))
    looks: list[tuple[float, ...]] = []
    with ServiceProcess(["run", "edge.toml"], folder, kernels) as service:
        address = service.wait_for_address()
        wait_until(lambda: get(*address, "/readyz")[0] == 200, f"not ready within {PATIENCE_S:g} s")
        begun_s, before = time.monotonic(), cpu_s(service.pid)
        with live_readers(address):
            while time.monotonic() - begun_s < 60.0 * minutes:
                looks.append(_look(service, address, begun_s))
                time.sleep(_PERIOD_S)
        used, elapsed_s = usage_of(service.pid), time.monotonic() - begun_s
    settled = np.array(looks[round(_WARM_UP_SHARE * len(looks)) :])
    hours = settled[:, 0] / 3600.0
    memory, descriptors, threads = (np.polyfit(hours, settled[:, k], 1)[0] for k in (1, 2, 3))
    name = f"{AXES} axes, {elapsed_s / 60.0:.0f} min"
    return [
        Figure(f"{name}: cores", (used.cpu_s - before) / elapsed_s, ""),
        Figure(f"{name}: peak memory", used.peak_mb, "MB", at_most=320.0),
        Figure(f"{name}: growth of memory", float(memory), "MB/h", at_most=1.0),
        Figure(f"{name}: growth of descriptors", float(descriptors), "1/h", at_most=1.0),
        Figure(f"{name}: growth of threads", float(threads), "1/h", at_most=1.0),
        Figure(f"{name}: answers without a number", float(settled[:, 4].sum()), "", at_most=0.0),
    ]


def _look(service: ServiceProcess, address: tuple[str, int], begun_s: float) -> tuple[float, ...]:
    """Time, memory, descriptors, threads, and the axes without a number."""
    answers = [get(*address, f"/api/v1/axes/A{k}/preload")[1] for k in range(1, AXES + 1)]
    for path in ("/metrics", *(f"/api/v1/axes/A{k}/history" for k in range(1, AXES + 1))):
        get(*address, path)
    without = sum(json.loads(each)["status"] != "estimated" for each in answers)
    counts = (len(list(Path(f"/proc/{service.pid}/{what}").iterdir())) for what in ("fd", "task"))
    return (time.monotonic() - begun_s, usage_of(service.pid).own_mb, *counts, without)


@contextmanager
def live_readers(address: tuple[str, int]) -> Iterator[None]:
    """Readers of the live stream, for as long as the context lasts."""
    stop = threading.Event()

    def read() -> None:
        connection: Any = http.client.HTTPConnection(*address, timeout=_TIMEOUT_S)
        with suppress(OSError, http.client.HTTPException):
            connection.request("GET", "/api/v1/events")
            response = connection.getresponse()
            while not stop.is_set() and response.read1(1 << 16):
                pass
        connection.close()

    threads = [threading.Thread(target=read, daemon=True) for _ in range(READERS)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()
