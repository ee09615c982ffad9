"""Speed and size of the whole service, measured from outside on processes of its own."""

import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..estimator.speed.speed import measure_estimator_speed
from ..identification.simulated_axis import simulation_share
from ..table import Figure, PipelineBench
from .live_load import INTERVAL_S, POLL_PERIOD_S, axes_text, cold_start_figures, live_figures
from .plant_speed import plant_figures
from .process_meter import read_stolen_s
from .replay_speed import measure_replay

AXIS_COUNTS = (1, 8)


@dataclass(frozen=True, slots=True)
class PipelineBenchSettings:
    """Measuring times of the pipeline bench.

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
        figures = cold_start_figures(folder, kernels)
        for axes in AXIS_COUNTS:
            progress(f"{axes_text(axes)} at 1 kHz: start, {2 * settings.window_s:g} s of running")
            figures += live_figures(folder, kernels, axes, settings.warm_up_s, settings.window_s)
        progress(f"replay of {settings.replay_s:g} s")
        figures += measure_replay(folder, kernels, settings.replay_s)
    progress("the simulated axis by itself; filter banks, compiled and filterpy")
    figures += [_simulation_figure(settings.window_s)]
    figures += plant_figures(settings.estimator_repeats)
    figures += _estimator_figures(settings.estimator_repeats)
    stolen = (read_stolen_s() - stolen_s) / (time.monotonic() - begun_s)
    return PipelineBench(tuple(figures), _notes(stolen))


def _simulation_figure(duration_s: float) -> Figure:
    return Figure(
        "cpu_simulation",
        "1 axis: processor, its simulated drive alone",
        simulation_share(duration_s),
        "cores",
    )


def _estimator_figures(repeats: int) -> list[Figure]:
    speed, unit = measure_estimator_speed(repeats), "steps/s"
    batch_times, single_times = speed.batch_over_filterpy, speed.single_over_filterpy
    return [
        Figure("bank_batch_per_s", "filter bank, whole run", speed.batch_steps_per_s, unit),
        Figure("bank_single_per_s", "filter bank, by steps", speed.single_steps_per_s, unit),
        Figure("bank_filterpy_per_s", "filterpy, by steps", speed.filterpy_steps_per_s, unit),
        Figure("bank_batch_over_filterpy", "whole run over filterpy", batch_times, "times"),
        Figure("bank_single_over_filterpy", "by steps over filterpy", single_times, "times"),
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
