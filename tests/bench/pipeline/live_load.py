"""A running service seen from outside: start, processor time, memory, and the delay of samples."""

import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from edge_service.messages.samples import Floats

from ..table import Figure, PipelineBenchError
from .process_meter import ServiceProcess, Usage
from .sample_delay import (
    PreloadPoller,
    Sighting,
    first_sightings,
    interval_delays_s,
    sample_delays_s,
    stamp_lateness_s,
)

AIMED_AXES = 8
CPU_AIM, PEAK_RSS_AIM_MB, DELAY_P99_AIM_S = 0.5, 300.0, 0.150
INTERVAL_S, SAMPLE_PERIOD_S = 0.1, 0.001
POLL_PERIOD_S = 0.005
_START_PATIENCE_S = 120.0
_BYTES_PER_MB = 1e6
_SERVICE = """\
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
[downsample]
interval_s = {interval_s}
"""
_AXIS = """
[[axes]]
name = "A{number}"
driver = "simulated"
[axes.settings]
scenario = "healthy"
rate_hz = {rate_hz}
seed = {number}
"""


@dataclass(frozen=True, slots=True)
class _RunningService:
    """A service whose first axis has a number.

    Attributes
    ----------
    page_s, estimated_s : float
        Time from its start until the page was served, and until the first number, s.
    """

    process: ServiceProcess
    poller: PreloadPoller
    page_s: float
    estimated_s: float


@dataclass(frozen=True, slots=True)
class _Window:
    """A span of a running service.

    Attributes
    ----------
    cpu_share : float
        Processor time over the window's length; 1 is one core.
    answers_per_s : float
        How often somebody asked, 1/s.
    usage : Usage
        At the window's end.
    """

    cpu_share: float
    answers_per_s: float
    usage: Usage


def cold_start_figures(folder: Path, kernels: Path) -> list[Figure]:
    """Start of one axis with an empty folder `kernels`, which it fills."""
    with _running(folder, kernels, axes=1) as service:
        peak_mb = service.process.usage().peak_rss_bytes / _BYTES_PER_MB
    peak = Figure("peak_rss_cold_1_mb", "cold start, 1 axis: peak memory", peak_mb, "MB")
    return [*_start_figures("cold", 1, service), peak]


def live_figures(
    folder: Path, kernels: Path, axes: int, warm_up_s: float, window_s: float
) -> list[Figure]:
    """Warm start of `axes` axes, then a window without and one with questions.

    Parameters
    ----------
    folder, kernels : Path
        Working folder, and the folder of the compiled kernels.
    warm_up_s, window_s : float
        Time between the first number and the first window, and length of each window, s.
    """
    with _running(folder, kernels, axes) as service:
        time.sleep(warm_up_s)
        alone, _ = _watch(service, window_s, _ask_nothing)
        asked, sightings = _watch(service, window_s, _ask_repeatedly)
    return [
        *_start_figures("warm", axes, service),
        *_usage_figures(axes, alone, asked),
        *_delay_figures(axes, sightings),
    ]


def write_config(path: Path, axes: int) -> None:
    """A configuration of `axes` healthy simulated axes A1, A2, ..., on free ports."""
    rate_hz = 1.0 / SAMPLE_PERIOD_S
    tables = [_AXIS.format(number=k, rate_hz=rate_hz) for k in range(1, axes + 1)]
    path.write_text(_SERVICE.format(interval_s=INTERVAL_S) + "".join(tables), "utf-8")


def axes_text(axes: int) -> str:
    """`1 axis`, `8 axes`."""
    return f"{axes} axis" if axes == 1 else f"{axes} axes"


@contextmanager
def _running(folder: Path, kernels: Path, axes: int) -> Iterator[_RunningService]:
    config = folder / f"{axes}_axes.toml"
    write_config(config, axes)
    with ServiceProcess(["run", str(config)], folder, kernels) as process:
        host, port = process.wait_for_address(_START_PATIENCE_S)
        page_s = process.since_start_s()
        with closing(PreloadPoller(host, port, "A1")) as poller:
            while poller.ask().status != "estimated":
                if process.since_start_s() > _START_PATIENCE_S:
                    raise PipelineBenchError(f"no preload within {_START_PATIENCE_S:g} s")
                time.sleep(POLL_PERIOD_S)
            yield _RunningService(process, poller, page_s, process.since_start_s())


def _watch(
    service: _RunningService,
    window_s: float,
    ask: Callable[[PreloadPoller, float], list[Sighting]],
) -> tuple[_Window, list[Sighting]]:
    """Count the processor time while `ask` runs."""
    before, start_s = service.process.usage(), time.monotonic()
    sightings = ask(service.poller, window_s)
    after, duration_s = service.process.usage(), time.monotonic() - start_s
    share = (after.cpu_s - before.cpu_s) / duration_s
    return _Window(share, len(sightings) / duration_s, after), sightings


def _ask_nothing(_poller: PreloadPoller, window_s: float) -> list[Sighting]:
    time.sleep(window_s)
    return []


def _ask_repeatedly(poller: PreloadPoller, window_s: float) -> list[Sighting]:
    end_s = time.monotonic() + window_s
    sightings = []
    while time.monotonic() < end_s:
        sightings.append(poller.ask())
        time.sleep(POLL_PERIOD_S)
    return sightings


def _start_figures(kind: str, axes: int, start: _RunningService) -> list[Figure]:
    name, key = f"{kind} start, {axes_text(axes)}", f"start_{kind}_{axes}"
    first = f"{name}: first preload `estimated`"
    return [
        Figure(f"{key}_page_s", f"{name}: page served", start.page_s, "s"),
        Figure(f"{key}_estimated_s", first, start.estimated_s, "s"),
    ]


def _usage_figures(axes: int, alone: _Window, asked: _Window) -> list[Figure]:
    cpu_aim, peak_aim = (CPU_AIM, PEAK_RSS_AIM_MB) if axes == AIMED_AXES else (None, None)
    name, usage = axes_text(axes), asked.usage
    peak_mb, end_mb = usage.peak_rss_bytes / _BYTES_PER_MB, usage.rss_bytes / _BYTES_PER_MB
    asked_name = f"{name}: processor, asked {asked.answers_per_s:.0f} times a second"
    return [
        Figure(f"cpu_{axes}", f"{name}: processor, nobody asks", alone.cpu_share, "cores", cpu_aim),
        Figure(f"cpu_{axes}_asked", asked_name, asked.cpu_share, "cores"),
        Figure(f"peak_rss_{axes}_mb", f"{name}: peak memory", peak_mb, "MB", peak_aim),
        Figure(f"rss_{axes}_mb", f"{name}: memory at the end", end_mb, "MB"),
    ]


def _delay_figures(axes: int, sightings: list[Sighting]) -> list[Figure]:
    firsts = first_sightings(sightings)
    if not firsts:
        raise PipelineBenchError(f"{axes_text(axes)}: no new interval was seen in the window")
    newest_s = interval_delays_s(firsts, INTERVAL_S)
    delays_s = sample_delays_s(newest_s, INTERVAL_S, SAMPLE_PERIOD_S)
    late_s = _quantile(stamp_lateness_s(firsts, INTERVAL_S), 99)
    name, key = f"{axes_text(axes)}: sample to `/preload`", f"delay_{axes}"
    aim = DELAY_P99_AIM_S if axes == AIMED_AXES else None
    late_name = f"{axes_text(axes)}: sample stamped late, 99th percentile"
    return [
        Figure(f"{key}_newest_median_s", f"{name}, newest, median", _quantile(newest_s, 50), "s"),
        Figure(f"{key}_median_s", f"{name}, median", _quantile(delays_s, 50), "s"),
        Figure(f"{key}_p99_s", f"{name}, 99th percentile", _quantile(delays_s, 99), "s", aim),
        Figure(f"{key}_stamp_p99_s", late_name, late_s, "s"),
    ]


def _quantile(values: Floats, percent: float) -> float:
    return float(np.percentile(values, percent))
