"""Speed of the service, each figure beside a peer or the bare parts in the same run."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..identification.simulated_axis import write_recording
from ..table import aligned, number_text
from .bank import measure_estimator_speed
from .paced import MOSQUITTO, Paced, measure_paced, service
from .page import CHROMIUM, page_times_ms
from .parts import estimator_us, history_us, ivp_s_per_axis_s, recorder_us
from .parts_of import SPEED_PARTS
from .plant_speed import AXIS_TIME_S, plant_figures
from .process_meter import ServiceProcess, read_stolen_s
from .replay_speed import measure_replay
from .requests import request_costs_us
from .sample_delay import PreloadPoller, first_sightings, interval_delays_s, sample_delays_s

_PATIENCE_S = 120.0
INTERVAL_S, SAMPLE_PERIOD_S = 0.1, 0.001
_POLL_PERIOD_S = 0.005


@dataclass(frozen=True, slots=True)
class SpeedSettings:
    """Extent of a run: `quick` is some three minutes."""

    parts: Collection[str] = SPEED_PARTS
    quick: bool = False

    @property
    def window_s(self) -> float:
        """Length of a window in which processor time is counted, s."""
        return 5.0 if self.quick else 30.0

    @property
    def warm_up_s(self) -> float:
        """Time between the page and the window, s."""
        return 8.0 if self.quick else 20.0

    @property
    def repeats(self) -> int:
        """Repeats behind a median."""
        return 3 if self.quick else 7

    @property
    def axes(self) -> tuple[int, ...]:
        """Numbers of axes whose cost is compared."""
        return (1, 4) if self.quick else (1, 4, 16, 64)


@dataclass(frozen=True, slots=True)
class Speed:
    """A figure of ours and its peer's.

    Attributes:
        peer: what it is compared with; empty for none.
        theirs: the same figure of the peer, in `unit`; None for none.
        ratio: how many times as good as the peer ours is; None without one.
        at_least, at_most: the aim; of the ratio if there is one, else of ours.
    """

    key: str
    name: str
    ours: float
    unit: str
    peer: str = ""
    theirs: float | None = None
    ratio: float | None = None
    at_least: float | None = None
    at_most: float | None = None

    @property
    def met(self) -> bool | None:
        """True if the aim is met; None without one."""
        value = self.ours if self.ratio is None else self.ratio
        if self.at_least is None and self.at_most is None:
            return None
        above = self.at_least is None or value >= self.at_least
        return above and (self.at_most is None or value <= self.at_most)

    def cells(self) -> tuple[str, ...]:
        """The row of a table."""
        theirs = "" if self.theirs is None else number_text(self.theirs)
        ratio = "" if self.ratio is None else number_text(self.ratio)
        limits = ((">=", self.at_least), ("<=", self.at_most))
        aim = ", ".join(f"{sign} {limit:g}" for sign, limit in limits if limit is not None)
        met = {None: "", True: "yes", False: "NO"}[self.met]
        return self.name, number_text(self.ours), self.unit, theirs, self.peer, ratio, aim, met


_HEADS = ("figure", "ours", "unit", "theirs", "of", "ratio", "aim", "met")


@dataclass(frozen=True, slots=True)
class SpeedTable:
    """All figures of one run, and what must be known to read them."""

    figures: tuple[Speed, ...]
    notes: tuple[str, ...]

    def as_text(self) -> str:
        """An aligned table, then the notes."""
        rows = [_HEADS, *(figure.cells() for figure in self.figures)]
        return "\n".join([*aligned(rows, right=(1, 3, 5)), "", *self.notes])

    def as_dict(self) -> dict[str, Any]:
        """JSON-able values."""
        figures = [asdict(figure) | {"met": figure.met} for figure in self.figures]
        return {"schema": "speed_bench/1", "figures": figures, "notes": list(self.notes)}


def less(
    key: str, name: str, ours: float, theirs: float, unit: str, peer: str, **aim: float
) -> Speed:
    """A figure of which less is better: the ratio tells how many times less ours is."""
    return Speed(key, name, ours, unit, peer, theirs, theirs / ours, **aim)


class SpeedBench:
    """One run; every part returns its figures.

    Args:
        progress: called with a line before each part.
    """

    def __init__(
        self, settings: SpeedSettings, folder: Path, progress: Callable[[str], None]
    ) -> None:
        self._settings, self._folder, self._progress = settings, folder, progress
        self._kernels, self._recording = folder / "kernels", folder / "recording.csv"

    def run(self) -> SpeedTable:
        """Measure all parts of the settings. Raises PipelineBenchError."""
        begun_s, stolen_s = time.monotonic(), read_stolen_s()
        write_recording(self._recording, 60.0 if self._settings.quick else 200.0)
        self._compile()
        figures: list[Speed] = []
        for name in SPEED_PARTS:
            if name in self._settings.parts:
                self._progress(name)
                figures += getattr(self, f"_{name}")()
        stolen = (read_stolen_s() - stolen_s) / (time.monotonic() - begun_s)
        return SpeedTable(tuple(figures), _notes(stolen))

    def _compile(self) -> None:
        """Have the kernels on the disk before anything is timed."""
        with service(self._folder, self._kernels, self._recording, 1) as process:
            process.wait_for_address(_PATIENCE_S)
            time.sleep(self._settings.warm_up_s)

    def _paced(self) -> list[Speed]:
        figures = []
        for axes, aim in ((1, 12.0), (8, 10.0)):
            name = f"{axes} {'axis' if axes == 1 else 'axes'} at 1 kHz"
            found = self._measured(axes)
            cost = f"{name}: processor per sample"
            if found.peer_us_per_sample is None:
                figures.append(Speed(f"paced_{axes}_us", cost, found.us_per_sample, "us"))
            else:
                peer = found.peer_us_per_sample
                figures.append(
                    less(
                        f"paced_{axes}_us",
                        cost,
                        found.us_per_sample,
                        peer,
                        "us",
                        "peer",
                        at_least=aim,
                    )
                )
            cores = found.us_per_sample * axes * 1e-3
            memory, most = found.usage.own_mb, 250.0 if axes == 8 else None
            figures += [
                Speed(
                    f"cores_{axes}", f"{name}: cores", cores, "", at_most=0.2 if axes == 8 else None
                ),
                Speed(
                    f"memory_{axes}_mb",
                    f"{name}: memory of the service",
                    memory,
                    "MB",
                    at_most=most,
                ),
                Speed(
                    f"shared_{axes}_mb",
                    f"{name}: with its reading processes",
                    found.usage.shared_mb,
                    "MB",
                ),
            ]
        return figures

    def _measured(self, axes: int, *, beside_peer: bool = True) -> Paced:
        settings = self._settings
        return measure_paced(
            self._folder,
            self._kernels,
            self._recording,
            axes,
            settings.warm_up_s,
            settings.window_s,
            beside_peer=beside_peer,
        )

    def _growth(self) -> list[Speed]:
        """Exponents of cost and memory over the number of axes, the fixed part included."""
        axes = self._settings.axes
        found = [self._measured(each, beside_peer=False) for each in axes]
        cores = [1e-3 * each.us_per_sample * n for each, n in zip(found, axes, strict=True)]
        memory = [each.usage.own_mb for each in found]
        span = f"from {axes[0]} to {axes[-1]} axes"
        most = f"{axes[-1]} axes"
        return [
            Speed("cores_most", f"{most}: cores", cores[-1], ""),
            Speed("memory_most_mb", f"{most}: memory of the service", memory[-1], "MB"),
        ] + [
            Speed(
                f"growth_{key}",
                f"{what} {span}: exponent",
                _exponent(axes, values),
                "",
                at_most=1.0,
            )
            for key, what, values in (("cores", "processor", cores), ("memory", "memory", memory))
        ]

    def _saturated(self) -> list[Speed]:
        seconds = 60.0 if self._settings.quick else 300.0
        found = {
            each.key: each.value for each in measure_replay(self._folder, self._kernels, seconds)
        }
        figures = [
            Speed(
                f"{key}_per_core", name, found[f"{key}_speed_per_core"], "x real time", at_least=aim
            )
            for key, name, aim in (
                ("replay", "a recording flat out through all nodes, per core", 150.0),
                ("estimate", "`estimate` over a recording, per core", None),
            )
            if f"{key}_speed_per_core" in found
        ]
        return [
            *figures,
            Speed(
                "lost", "intervals lost flat out", found["replay_lost_intervals"], "", at_most=0.0
            ),
        ]

    def _estimator(self) -> list[Speed]:
        speed = measure_estimator_speed(self._settings.repeats)
        ours_us, theirs_us = estimator_us(self._recording, self._settings.repeats)
        filterpy = 1e6 / speed.filterpy_steps_per_s
        return [
            less(f"bank_{key}_us", name, 1e6 / steps, filterpy, "us", "filterpy")
            for key, name, steps in (
                ("batch", "five modes, a whole run: each step", speed.batch_steps_per_s),
                ("single", "five modes, sample by sample: each step", speed.single_steps_per_s),
            )
        ] + [
            less(
                "interval_us",
                "mixture estimator: each interval",
                ours_us,
                theirs_us,
                "us",
                "filterpy's five modes",
            )
        ]

    def _plant(self) -> list[Speed]:
        theirs = ivp_s_per_axis_s(self._settings.repeats) * AXIS_TIME_S
        return [
            less(each.key, each.name, each.value, theirs, "s", "solve_ivp, two masses")
            for each in plant_figures(self._settings.repeats)
        ]

    def _recorder(self) -> list[Speed]:
        ours, theirs = recorder_us(60_000, self._settings.repeats)
        return [less("recorder_us", "recorder: each sample", ours, theirs, "us", "numpy.save")]

    def _history(self) -> list[Speed]:
        ours, theirs = history_us(self._settings.repeats)
        name = "history of a year in 1000 buckets, off the disk: processor"
        return [less("history_ms", name, ours / 1e3, theirs / 1e3, "ms", "pyarrow, the bare file")]

    def _requests(self) -> list[Speed]:
        count = 300 if self._settings.quick else 3000
        with service(self._folder, self._kernels, self._recording, 1) as process:
            host, port = process.wait_for_address(_PATIENCE_S)
            time.sleep(self._settings.warm_up_s)
            ours, theirs = request_costs_us(process, host, port, count)
        name = "GET /preload: processor"
        return [less("get_us", name, ours, theirs, "us", "bare uvicorn", at_least=0.25)]

    def _start(self) -> list[Speed]:
        page, first, helped = [], [], []
        for _ in range(self._settings.repeats):
            with service(self._folder, self._kernels, self._recording, 1) as process:
                host, port = process.wait_for_address(_PATIENCE_S)
                page.append(process.since_start_s())
                first.append(_first_answer_s(process, host, port))
            helped.append(_spent(["--help"], self._folder, self._kernels)[0])
        return [
            Speed("help_s", "edge-service --help", float(np.median(helped)), "s", at_most=0.3),
            Speed("page_s", "start to the page", float(np.median(page)), "s"),
            Speed("first_s", "start to the first `estimated`", float(np.median(first)), "s"),
        ]

    def _delay(self) -> list[Speed]:
        """Time from a sample until `/preload` rests on it."""
        figures = []
        for axes in (1, 8):
            with service(self._folder, self._kernels, self._recording, axes) as process:
                host, port = process.wait_for_address(_PATIENCE_S)
                time.sleep(self._settings.warm_up_s)
                poller, sightings = PreloadPoller(host, port, "A1"), []
                until_s = time.monotonic() + self._settings.window_s
                while time.monotonic() < until_s:
                    sightings.append(poller.ask())
                    time.sleep(_POLL_PERIOD_S)
                poller.close()
            newest_s = interval_delays_s(first_sightings(sightings), INTERVAL_S)
            delays_s = sample_delays_s(newest_s, INTERVAL_S, SAMPLE_PERIOD_S)
            name = f"sample to `/preload`, {axes} {'axis' if axes == 1 else 'axes'}"
            figures += [
                Speed(f"delay_{axes}_{percent}_ms", f"{name}: {percent}th percentile", value, "ms")
                for percent, value in (
                    (each, 1e3 * float(np.percentile(delays_s, each))) for each in (50, 99)
                )
            ]
        return figures

    def _page(self) -> list[Speed]:
        """Figures of a browser; none without Chromium."""
        if CHROMIUM is None:
            return []
        figures = []
        for axes in (1, 8):
            with service(self._folder, self._kernels, self._recording, axes) as process:
                host, port = process.wait_for_address(_PATIENCE_S)
                time.sleep(self._settings.warm_up_s)
                times_ms = page_times_ms(host, port, self._settings.repeats)
            painted, headline = np.median(times_ms, axis=0)
            name = f"page, {axes} {'axis' if axes == 1 else 'axes'}"
            figures += [
                Speed(f"paint_{axes}_ms", f"{name}: first paint", float(painted), "ms"),
                Speed(f"headline_{axes}_ms", f"{name}: its headline", float(headline), "ms"),
            ]
        return figures

    def _diagnosis(self) -> list[Speed]:
        """A recording of 190 s of production, of a machine that nobody has seen."""
        trace, out = self._folder / "diagnosed.csv", self._folder / "diagnosis"
        write_recording(trace, 60.0 if self._settings.quick else 190.0)
        line = ["diagnose", str(trace), "--out", str(out)]
        _translate("edge_service.offline.diagnosis.diagnose", self._kernels)
        new, again = (_spent(line, self._folder, self._kernels)[1] for _ in range(2))
        return [
            Speed(
                "diagnosis_new_s", "diagnosis, machine never met: processor", new, "s", at_most=20.0
            ),
            Speed("diagnosis_again_s", "the same again: processor", again, "s", at_most=8.0),
        ]


def _first_answer_s(process: ServiceProcess, host: str, port: int) -> float:
    poller = PreloadPoller(host, port, "A1")
    while process.since_start_s() < _PATIENCE_S:
        if poller.ask().status == "estimated":
            break
        time.sleep(INTERVAL_S / 10.0)
    return process.since_start_s()


def _spent(line: list[str], folder: Path, kernels: Path) -> tuple[float, float]:
    """Elapsed time, and processor time of a command with all that it starts, s."""
    before, begun_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "edge_service", *line],
        cwd=folder,
        env=_installed(kernels),
        capture_output=True,
        check=False,
    )
    elapsed_s, after = time.monotonic() - begun_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    return elapsed_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _translate(module: str, kernels: Path) -> None:
    """Have the bytecode of a module, and of all that it imports, on the disk."""
    line = [sys.executable, "-c", f"import {module}"]
    subprocess.run(line, env=_installed(kernels), capture_output=True, check=False)


def _installed(kernels: Path) -> dict[str, str]:
    """Environment with kernels and bytecode on the disk, as an installation has both.

    A checkout whose environment forbids bytecode translates 1,400 modules at each start.
    """
    kept = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(kernels / "bytecode")}
    return os.environ | {"NUMBA_CACHE_DIR": str(kernels)} | kept


def _exponent(axes: Collection[int], costs: list[float]) -> float:
    return float(np.polyfit(np.log(list(axes)), np.log(costs), 1)[0])


def _notes(stolen: float) -> tuple[str, ...]:
    broker = () if MOSQUITTO else ("There is no mosquitto here, so no peer was measured.",)
    return (
        "The peer: paho, one JSON message per sample over mosquitto, five modes of filterpy at "
        "10 Hz; it works in the same seconds, checks nothing and keeps nothing.",
        "A ratio tells how many times less ours takes; below 1 it takes more.",
        f"{os.cpu_count()} cores, of which a host gave {stolen:.2f} to others meanwhile.",
        *broker,
    )


def run_speed_bench(
    settings: SpeedSettings, progress: Callable[[str], None] = lambda _line: None
) -> SpeedTable:
    """Measure everything. Raises PipelineBenchError."""
    with tempfile.TemporaryDirectory(prefix="edge-service-speed-") as name:
        return SpeedBench(settings, Path(name), progress).run()
