"""Speed of the service, each figure beside a peer or the bare parts in the same run."""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np

from ..identification.simulated_axis import write_recording
from ..table import Figure, Progress, Table, figures_table
from .bare import request_costs_us
from .delay import PreloadPoller, sample_delays_s
from .estimator_cost import estimator_us
from .paced import MOSQUITTO, RATE_HZ, Paced, measure_paced, service
from .parts_of import SPEED_PARTS
from .process_meter import PATIENCE_S, ServiceProcess, cpu_s, kept_in, read_stolen_s, usage_of
from .replay_speed import replay_figures
from .soak import soak


class SpeedBench:
    """One run; every part returns its figures.

    Args:
        quick: some three minutes in all.
        progress: called with a line before each part.
    """

    def __init__(self, folder: Path, quick: bool, progress: Progress) -> None:
        self._folder, self._quick, self._progress = folder, quick, progress
        self._kernels, self._recording = folder / "kernels", folder / "recording.csv"
        self._window_s, self._warm_up_s = (5.0, 8.0) if quick else (30.0, 20.0)
        self._repeats = 3 if quick else 7

    def run(self, parts: Collection[str]) -> Table:
        begun_s, stolen_s = time.monotonic(), read_stolen_s()
        write_recording(self._recording, 60.0 if self._quick else 200.0)
        self._started()  # has the kernels on the disk before anything is timed
        figures: list[Figure] = []
        for name in SPEED_PARTS:
            if name in parts:
                self._progress(name)
                figures += getattr(self, f"_{name}")()
        stolen = (read_stolen_s() - stolen_s) / (time.monotonic() - begun_s)
        notes = (
            "The peer: paho, one JSON message per sample over mosquitto, five modes of filterpy at "
            "10 Hz; it works in the same seconds, checks nothing and keeps nothing.",
            "A ratio tells how many times less ours takes; below 1 it takes more.",
            f"{os.cpu_count()} cores, of which a host gave {stolen:.2f} to others meanwhile.",
            "" if MOSQUITTO else "There is no mosquitto here, so no peer was measured.",
        )
        return figures_table(figures, [note for note in notes if note])

    @contextmanager
    def _service(self, axes: int) -> Iterator[ServiceProcess]:
        with service(self._folder, self._kernels, self._recording, axes) as process:
            process.wait_for_address()
            time.sleep(self._warm_up_s)
            yield process

    def _measured(self, axes: int, recording: Path | None = None, rate_hz: float = 0.0) -> Paced:
        """Beside the peer, unless a rate is given."""
        places = self._folder, self._kernels, recording or self._recording
        return measure_paced(*places, axes, self._warm_up_s, self._window_s, rate_hz)

    def _paced(self) -> list[Figure]:
        figures = []
        for axes, aim in ((1, 12.0), (8, 10.0)):
            found, name = self._measured(axes), f"{_axes(axes)} at 1 kHz"
            us, theirs = found.us_per_sample, found.peer_us_per_sample
            least = None if theirs is None else aim
            cores, memory = (0.15, 250.0) if axes == 8 else (None, None)
            figures += [
                Figure(f"{name}: processor per sample", us, "us", theirs, "peer", at_least=least),
                Figure(f"{name}: cores", 1e-3 * us * axes, "", at_most=cores),
                Figure(f"{name}: memory", found.usage.own_mb, "MB", at_most=memory),
                Figure(f"{name}: with child processes", found.usage.shared_mb, "MB"),
            ]
        return figures

    def _growth(self) -> list[Figure]:
        """Exponents over axes, rate and length of recordings, the fixed part included."""
        axes = (1, 4) if self._quick else (1, 4, 16, 64)
        found = [self._measured(each, rate_hz=RATE_HZ) for each in axes]
        cores = [1e-3 * each.us_per_sample * n for each, n in zip(found, axes, strict=True)]
        memory = [each.usage.own_mb for each in found]
        figures = [
            Figure(f"{axes[-1]} axes: cores", cores[-1], ""),
            Figure(f"{axes[-1]} axes: memory", memory[-1], "MB"),
        ]
        figures += [_exponent("processor", axes, "axes", cores)]
        figures += [_exponent("memory", axes, "axes", memory)]
        rates, cores, trace = (500, 1000, 2000, 4000, 8000), [], self._folder / "grown.csv"
        for rate_hz in rates:
            write_recording(trace, 60.0, rate_hz)
            cores.append(1e-6 * self._measured(1, trace, rate_hz).us_per_sample * rate_hz)
        figures.append(_exponent("processor", rates, "Hz", cores))
        spans, spent = (10, 60) if self._quick else (60, 600, 3600), []
        for span_s in (10, *spans):  # the first for the kernels
            write_recording(trace, span_s)
            spent.append(self._spent("estimate", str(trace), "--out", "estimates.csv"))
        _, spent_s, mb = zip(*spent[1:], strict=True)
        figures.append(Figure(f"`estimate` of {spans[-1]} s: memory", mb[-1], "MB", at_most=250.0))
        figures += [_exponent("`estimate`, processor", spans, "s", spent_s)]
        return [*figures, _exponent("`estimate`, memory", spans, "s", mb)]

    def _jobs(self) -> list[Figure]:
        traces = [self._folder / f"case{k}.csv" for k in range(4)]
        for each in traces:
            write_recording(each, 60.0)
        line = "diagnose", *map(str, traces), "--out", "cases", "--each", "--jobs"
        one_s, two_s = (self._spent(*line, jobs)[0] for jobs in ("1", "2"))
        return [Figure("four recordings, two jobs", two_s, "s", one_s, "one job", at_least=1.6)]

    def _saturated(self) -> list[Figure]:
        return replay_figures(self._folder, self._kernels, 60.0 if self._quick else 300.0)

    def _estimator(self) -> list[Figure]:
        ours, compiled, filterpy, theirs = estimator_us(self._recording, self._repeats)
        return [
            Figure("mixture estimator: each interval", ours, "us", theirs, "filterpy"),
            Figure("second opinion, compiled: of a core", 1e-3 * compiled, "%", at_most=0.3),
            Figure("second opinion, filterpy: of a core", 1e-3 * filterpy, "%", at_most=2.0),
        ]

    def _requests(self) -> list[Figure]:
        with self._service(1) as process:
            count = 300 if self._quick else 3000
            ours, theirs = request_costs_us(process, *process.wait_for_address(), count)
        name = "GET /preload: processor"
        return [Figure(name, ours, "us", theirs, "bare uvicorn", at_least=0.25)]

    def _started(self) -> tuple[float, float]:
        """Time from the start of a service to its page, and to the first `estimated`, s."""
        with service(self._folder, self._kernels, self._recording, 1) as process:
            with closing(PreloadPoller(*process.wait_for_address(), "A1")) as poller:
                page_s = process.since_start_s()
                while poller.ask()[0] != "estimated" and process.since_start_s() < PATIENCE_S:
                    time.sleep(0.01)
            return page_s, process.since_start_s()

    def _start(self) -> list[Figure]:
        times = [(self._spent("--help")[0], *self._started()) for _ in range(self._repeats)]
        helped, page, first = np.median(times, axis=0)
        return [
            Figure("edge-service --help", float(helped), "s", at_most=0.3),
            Figure("start to the page", float(page), "s", at_most=1.0),
            Figure("start to the first `estimated`", float(first), "s", at_most=2.2),
        ]

    def _delay(self) -> list[Figure]:
        """Time from a sample until `/preload` rests on it."""
        figures = []
        for axes in (1, 8):
            with self._service(axes) as process:
                delays_s = sample_delays_s(*process.wait_for_address(), "A1", self._window_s)
            for percent in (50, 99):
                name = f"sample to `/preload`, {_axes(axes)}: {percent}th percentile"
                delay_ms = 1e3 * float(np.percentile(delays_s, percent))
                most = 110.0 if percent == 99 else None
                figures.append(Figure(name, delay_ms, "ms", at_most=most))
        return figures

    def _diagnosis(self) -> list[Figure]:
        """A recording of 190 s of production, of a machine that nobody has seen."""
        trace = self._folder / "diagnosed.csv"
        line = ("diagnose", str(trace), "--out", str(self._folder / "diagnosis"))
        for span_s in (20.0, 60.0 if self._quick else 190.0):  # the first for the kernels
            write_recording(trace, span_s)
            (_, new, _), (_, again, mb) = (self._spent(*line) for _ in range(2))
        return [
            Figure("diagnosis, machine never met: processor", new, "s", at_most=10.0),
            Figure("the same again: processor", again, "s", at_most=6.0),
            Figure("the same again: memory", mb, "MB", at_most=400.0),
        ]

    def _soak(self) -> list[Figure]:
        return soak(self._folder, self._kernels, 5.0 if self._quick else 60.0)

    def _spent(self, *line: str) -> tuple[float, float, float]:
        """Elapsed and processor time, s, and peak memory, MB, of a command and what it starts."""
        command, none = [sys.executable, "-m", "edge_service", *line], subprocess.DEVNULL
        env = os.environ | kept_in(self._kernels)
        told = {"cwd": self._folder, "env": env, "stdout": none, "stderr": none}
        begun_s, process = time.monotonic(), subprocess.Popen(command, **cast(Any, told))
        peak_mb, ended = 0.0, os.WEXITED | os.WNOHANG | os.WNOWAIT
        while os.waitid(os.P_PID, process.pid, ended) is None:
            peak_mb = max(peak_mb, usage_of(process.pid).peak_mb)
            time.sleep(0.05)
        spent_s, elapsed_s = cpu_s(process.pid), time.monotonic() - begun_s
        process.wait()
        return elapsed_s, spent_s, peak_mb


def _exponent(what: str, sizes: Sequence[float], unit: str, values: Sequence[float]) -> Figure:
    """Slope of the logarithms of values over those of sizes."""
    name = f"{what} from {sizes[0]} to {sizes[-1]} {unit}: exponent"
    return Figure(name, float(np.polyfit(np.log(sizes), np.log(values), 1)[0]), "", at_most=1.0)


def _axes(count: int) -> str:
    return "1 axis" if count == 1 else f"{count} axes"


def run_speed_bench(parts: Collection[str], quick: bool, progress: Progress) -> Table:
    """Measure everything. Raises BenchError."""
    with tempfile.TemporaryDirectory(prefix="edge-service-speed-") as name:
        return SpeedBench(Path(name), quick, progress).run(parts)
