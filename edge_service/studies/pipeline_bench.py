"""Speed and size of the whole service, measured from outside on processes of its own."""

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .bench_figures import Figure, PipelineBench, PipelineBenchError
from .estimator_speed import measure_estimator_speed
from .process_meter import ServiceProcess, Usage, read_stolen_s
from .replay_speed import measure_replay
from .sample_delay import (
    PreloadPoller,
    Sighting,
    first_sightings,
    interval_delays_s,
    sample_delays_s,
    stamp_lateness_s,
)
from .simulated_axis import simulation_share

AXIS_COUNTS = (1, 8)
AIMED_AXES = 8
CPU_AIM, PEAK_RSS_AIM_MB, DELAY_P99_AIM_S = 0.5, 300.0, 0.150
INTERVAL_S, SAMPLE_PERIOD_S = 0.1, 0.001
POLL_PERIOD_S = 0.005
START_PATIENCE_S = 120.0
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
class PipelineBenchSettings:
    """How long the bench looks.

    Attributes
    ----------
    quick : bool
        Short windows, under a minute in all; else under three minutes.
    """

    quick: bool = False

    @property
    def warm_up_s(self) -> float:
        """Time between the first number and the first window, s."""
        return 0.5 if self.quick else 5.0

    @property
    def window_s(self) -> float:
        """Length of a window in which processor time is counted, s."""
        return 2.5 if self.quick else 20.0

    @property
    def replay_s(self) -> float:
        """Axis time of the recording, s."""
        return 60.0 if self.quick else 300.0

    @property
    def estimator_repeats(self) -> int:
        """Repeats behind the medians of the filter banks' speed."""
        return 3 if self.quick else 7


@dataclass(frozen=True, slots=True)
class _Start:
    page_s: float
    estimated_s: float


@dataclass(frozen=True, slots=True)
class _Window:
    """One window of a running service.

    Attributes
    ----------
    cpu_share : float
        Processor time over the window's length; 1 is one core.
    usage : Usage
        At the window's end.
    sightings : list of Sighting
        Answers in the window; empty if nobody asked.
    """

    cpu_share: float
    duration_s: float
    usage: Usage
    sightings: list[Sighting]


def run_pipeline_bench(
    settings: PipelineBenchSettings, progress: Callable[[str], None] = lambda _line: None
) -> PipelineBench:
    """Measure start, processor time, memory, delay, replay and the estimator.

    Parameters
    ----------
    settings : PipelineBenchSettings
        How long to look.
    progress : Callable
        Called with a line before each part.

    Raises
    ------
    PipelineBenchError
        A process failed, or the system has no /proc; the text is one line.
    """
    begun_s, stolen_s = time.monotonic(), read_stolen_s()
    with tempfile.TemporaryDirectory(prefix="edge-service-bench-") as name:
        folder, kernels = Path(name), Path(name) / "kernels"
        progress("cold start, 1 axis: no compiled kernels kept")
        figures = _start_figures("cold", 1, _cold_start(folder, kernels))
        for axes in AXIS_COUNTS:
            progress(f"{axes_text(axes)} at 1 kHz: start, {2 * settings.window_s:g} s of running")
            figures += _live_figures(settings, folder, kernels, axes)
        progress(f"replay of {settings.replay_s:g} s")
        figures += measure_replay(folder, kernels, settings.replay_s)
    progress("the simulated axis by itself; filter banks, compiled and filterpy")
    figures += [_simulation_figure(settings.window_s)]
    figures += _estimator_figures(settings.estimator_repeats)
    stolen = (read_stolen_s() - stolen_s) / (time.monotonic() - begun_s)
    return PipelineBench(tuple(figures), _notes(stolen))


def write_config(path: Path, axes: int) -> None:
    """A configuration of `axes` healthy simulated axes A1, A2, ..., on free ports."""
    rate_hz = 1.0 / SAMPLE_PERIOD_S
    tables = [_AXIS.format(number=k, rate_hz=rate_hz) for k in range(1, axes + 1)]
    path.write_text(_SERVICE.format(interval_s=INTERVAL_S) + "".join(tables), "utf-8")


@contextmanager
def _running(
    folder: Path, kernels: Path, axes: int
) -> Iterator[tuple[ServiceProcess, PreloadPoller, _Start]]:
    """A service of `axes` axes whose first axis has a number."""
    config = folder / f"{axes}_axes.toml"
    write_config(config, axes)
    with ServiceProcess(["run", str(config)], folder, kernels) as service:
        host, port = service.wait_for_address(START_PATIENCE_S)
        page_s = service.since_start_s()
        with closing(PreloadPoller(host, port, "A1")) as poller:
            while poller.ask().status != "estimated":
                if service.since_start_s() > START_PATIENCE_S:
                    raise PipelineBenchError(f"no preload within {START_PATIENCE_S:g} s")
                time.sleep(POLL_PERIOD_S)
            yield service, poller, _Start(page_s, service.since_start_s())


def _cold_start(folder: Path, kernels: Path) -> _Start:
    with _running(folder, kernels, axes=1) as (_, _, start):
        return start


def _start_figures(kind: str, axes: int, start: _Start) -> list[Figure]:
    name = f"{kind} start, {axes_text(axes)}"
    return [
        Figure(f"start_{kind}_{axes}_page_s", f"{name}: page served", start.page_s, "s"),
        Figure(
            f"start_{kind}_{axes}_estimated_s",
            f"{name}: first preload `estimated`",
            start.estimated_s,
            "s",
        ),
    ]


def axes_text(axes: int) -> str:
    """`1 axis`, `8 axes`."""
    return f"{axes} axis" if axes == 1 else f"{axes} axes"


def _live_figures(
    settings: PipelineBenchSettings, folder: Path, kernels: Path, axes: int
) -> list[Figure]:
    with _running(folder, kernels, axes) as (service, poller, start):
        time.sleep(settings.warm_up_s)
        alone = _watch(service, settings.window_s, None)
        asked = _watch(service, settings.window_s, poller)
    return [
        *_start_figures("warm", axes, start),
        *_usage_figures(axes, alone, asked),
        *_delay_figures(axes, asked.sightings),
    ]


def _watch(service: ServiceProcess, window_s: float, poller: PreloadPoller | None) -> _Window:
    """Count the processor time of a window, with somebody asking in it or nobody."""
    before, start_s = service.usage(), time.monotonic()
    sightings = []
    if poller is None:
        time.sleep(window_s)
    while (duration_s := time.monotonic() - start_s) < window_s:
        assert poller is not None
        sightings.append(poller.ask())
        time.sleep(POLL_PERIOD_S)
    after = service.usage()
    return _Window((after.cpu_s - before.cpu_s) / duration_s, duration_s, after, sightings)


def _usage_figures(axes: int, alone: _Window, asked: _Window) -> list[Figure]:
    aimed = axes == AIMED_AXES
    name, rate_hz = axes_text(axes), len(asked.sightings) / asked.duration_s
    cpu_aim, peak_aim = (CPU_AIM, PEAK_RSS_AIM_MB) if aimed else (None, None)
    peak_mb = asked.usage.peak_rss_bytes / _BYTES_PER_MB
    return [
        Figure(f"cpu_{axes}", f"{name}: processor, nobody asks", alone.cpu_share, "cores", cpu_aim),
        Figure(
            f"cpu_{axes}_asked",
            f"{name}: processor, asked {rate_hz:.0f} times a second",
            asked.cpu_share,
            "cores",
        ),
        Figure(f"peak_rss_{axes}_mb", f"{name}: peak memory", peak_mb, "MB", peak_aim),
        Figure(f"rss_{axes}_mb", f"{name}: memory", asked.usage.rss_bytes / _BYTES_PER_MB, "MB"),
    ]


def _delay_figures(axes: int, sightings: list[Sighting]) -> list[Figure]:
    firsts = first_sightings(sightings)
    if not firsts:
        raise PipelineBenchError(f"{axes_text(axes)}: no new interval was seen in the window")
    newest_s = interval_delays_s(firsts, INTERVAL_S)
    delays_s = sample_delays_s(newest_s, INTERVAL_S, SAMPLE_PERIOD_S)
    lateness_s = stamp_lateness_s(firsts, INTERVAL_S)
    name, key = f"{axes_text(axes)}: sample to `/preload`", f"delay_{axes}"
    aim = DELAY_P99_AIM_S if axes == AIMED_AXES else None
    return [
        Figure(f"{key}_newest_median_s", f"{name}, newest, median", _quantile(newest_s, 50), "s"),
        Figure(f"{key}_median_s", f"{name}, median", _quantile(delays_s, 50), "s"),
        Figure(f"{key}_p99_s", f"{name}, 99th percentile", _quantile(delays_s, 99), "s", aim),
        Figure(
            f"{key}_stamp_p99_s",
            f"{axes_text(axes)}: sample stamped late, 99th percentile",
            _quantile(lateness_s, 99),
            "s",
        ),
    ]


def _quantile(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], percent: float) -> float:
    return float(np.percentile(values, percent))


def _simulation_figure(duration_s: float) -> Figure:
    return Figure(
        "cpu_simulation",
        "1 axis: processor, its simulated drive alone",
        simulation_share(duration_s),
        "cores",
    )


def _estimator_figures(repeats: int) -> list[Figure]:
    speed = measure_estimator_speed(repeats)
    compiled, filterpy = "filter bank, compiled", "filter bank, filterpy"
    return [
        Figure("bank_batch_per_s", f"{compiled}, whole run", speed.batch_steps_per_s, "steps/s"),
        Figure("bank_single_per_s", f"{compiled}, step", speed.single_steps_per_s, "steps/s"),
        Figure("bank_filterpy_per_s", f"{filterpy}, step", speed.filterpy_steps_per_s, "steps/s"),
        Figure(
            "bank_batch_over_filterpy",
            "whole run over filterpy",
            speed.batch_over_filterpy,
            "times",
        ),
        Figure(
            "bank_single_over_filterpy", "step over filterpy", speed.single_over_filterpy, "times"
        ),
    ]


def _notes(stolen: float) -> tuple[str, ...]:
    return (
        f"Python {platform.python_version()}, {os.cpu_count()} cores, of which the host of a "
        f"virtual machine gave {stolen:.2f} to others meanwhile; that, and other work on the "
        "machine, slows the figures.",
        "The processor's share contains the simulated drives, which a real machine does not need.",
        "The first `estimated` contains 1 s of motion that the estimator needs before it says a "
        "number.",
        "A sample's delay ends with the answer in the asker's hand: up to "
        f"{1e3 * POLL_PERIOD_S:g} ms of it is the wait between two questions, and on average half "
        f"of the interval of {INTERVAL_S:g} s is the wait for the interval's end.",
        "`sample stamped late` is what the driver's own stamp lags behind a typical one on a "
        "steady clock; it comes on top of a delay.",
        "`without start-up` compares the processor time of the recording with that of a short one.",
    )
