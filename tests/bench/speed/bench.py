"""Speed of the service, each figure beside a peer or the bare parts in the same run."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from ..identification.simulated_axis import write_recording
from ..table import Figure, Progress, Table, figures_table
from .bare import request_costs_us
from .delay import PreloadPoller, sample_delays_s
from .estimator_cost import estimator_us
from .paced import MOSQUITTO, Paced, measure_paced, service
from .parts_of import SPEED_PARTS
from .process_meter import PATIENCE_S, ServiceProcess, read_stolen_s
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

    def _measured(self, axes: int, *, beside_peer: bool = True) -> Paced:
        return measure_paced(
            self._folder,
            self._kernels,
            self._recording,
            axes,
            self._warm_up_s,
            self._window_s,
            beside_peer=beside_peer,
        )

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
        """Exponents of cost and memory over the number of axes, the fixed part included."""
        axes = (1, 4) if self._quick else (1, 4, 16, 64)
        found = [self._measured(each, beside_peer=False) for each in axes]
        cores = [1e-3 * each.us_per_sample * n for each, n in zip(found, axes, strict=True)]
        memory = [each.usage.own_mb for each in found]
        figures = [
            Figure(f"{axes[-1]} axes: cores", cores[-1], ""),
            Figure(f"{axes[-1]} axes: memory", memory[-1], "MB"),
        ]
        for what, values in (("processor", cores), ("memory", memory)):
            exponent = float(np.polyfit(np.log(axes), np.log(values), 1)[0])
            name = f"{what} from 1 to {axes[-1]} axes: exponent"
            figures.append(Figure(name, exponent, "", at_most=1.0))
        return figures

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
                figures.append(
                    Figure(name, delay_ms, "ms", at_most=110.0 if percent == 99 else None)
                )
        return figures

    def _diagnosis(self) -> list[Figure]:
        """A recording of 190 s of production, of a machine that nobody has seen."""
        trace = self._folder / "diagnosed.csv"
        write_recording(trace, 60.0 if self._quick else 190.0)
        self._spent("diagnose", "--help")
        line = ("diagnose", str(trace), "--out", str(self._folder / "diagnosis"))
        new, again = (self._spent(*line)[1] for _ in range(2))
        return [
            Figure("diagnosis, machine never met: processor", new, "s", at_most=10.0),
            Figure("the same again: processor", again, "s", at_most=6.0),
        ]

    def _soak(self) -> list[Figure]:
        return soak(self._folder, self._kernels, 5.0 if self._quick else 60.0)

    def _spent(self, *line: str) -> tuple[float, float]:
        """Elapsed time, and processor time of a command with all that it starts, s.

        Bytecode is on the disk, as in an installation: a checkout may forbid it.
        """
        kept = {"PYTHONDONTWRITEBYTECODE": "", "NUMBA_CACHE_DIR": str(self._kernels)}
        kept["PYTHONPYCACHEPREFIX"] = str(self._kernels / "bytecode")
        before, begun_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        subprocess.run(
            [sys.executable, "-m", "edge_service", *line],
            cwd=self._folder,
            env=os.environ | kept,
            capture_output=True,
            check=False,
        )
        elapsed_s, after = time.monotonic() - begun_s, resource.getrusage(resource.RUSAGE_CHILDREN)
        return elapsed_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _axes(count: int) -> str:
    return "1 axis" if count == 1 else f"{count} axes"


def run_speed_bench(parts: Collection[str], quick: bool, progress: Progress) -> Table:
    """Measure everything. Raises BenchError."""
    with tempfile.TemporaryDirectory(prefix="edge-service-speed-") as name:
        return SpeedBench(Path(name), quick, progress).run(parts)
