"""Speed of a recording through the service and the estimator, as a multiple of real time."""

import re
from collections.abc import Sequence
from pathlib import Path

from ..identification.simulated_axis import write_recording
from ..table import Figure, PipelineBenchError
from .process_meter import FinishedRun, ServiceProcess

SHORT_S = 5.0
_PATIENCE_S = 300.0
_COUNTED = re.compile(r"(\d+) (?:estimates|blocks)\b")


def measure_replay(folder: Path, kernels: Path, recording_s: float) -> list[Figure]:
    """Speeds of `replay --speed 0` and `estimate` in times real time.

    Parameters
    ----------
    folder : Path
        Where the recordings are written.
    kernels : Path
        Folder of the compiled kernels.
    recording_s : float
        Axis time of the long recording, s.
    """
    short, long = folder / "short.csv", folder / "long.csv"
    write_recording(short, SHORT_S)
    write_recording(long, recording_s)
    free = ["--speed", "0", "--port", "0", "--bus", "tcp/127.0.0.1:0"]
    out = ["--out", str(folder / "estimates.csv")]
    replays = [_run(["replay", str(trace), *free], folder, kernels) for trace in (short, long)]
    estimates = [_run(["estimate", str(trace), *out], folder, kernels) for trace in (short, long)]
    lost = estimate_count(estimates[1].output) - estimate_count(replays[1].output)
    return [
        *_speed_figures("replay", recording_s, *replays),
        Figure("replay_lost_intervals", "replay: intervals lost", lost, "", 0.0),
        *_speed_figures("estimate", recording_s, *estimates),
    ]


def _run(arguments: Sequence[str], folder: Path, kernels: Path) -> FinishedRun:
    with ServiceProcess(arguments, folder, kernels) as process:
        return process.wait_for_end(_PATIENCE_S)


def estimate_count(output: str) -> int:
    """Number of estimates that `replay` or `estimate` says it made."""
    found = _COUNTED.search(output)
    if found is None:
        raise PipelineBenchError(f"no count of estimates in {output.strip()!r}")
    return int(found[1])


def _speed_figures(
    command: str, recording_s: float, short: FinishedRun, long: FinishedRun
) -> list[Figure]:
    name, unit = f"{command} of {recording_s:g} s", "x real time"
    whole = Figure(f"{command}_speed", f"{name}, whole process", recording_s / long.elapsed_s, unit)
    running = running_speed(short, long, recording_s - SHORT_S)
    if running is None:
        return [whole]
    each = f"{name}, without start-up, per core"
    return [whole, Figure(f"{command}_speed_per_core", each, running, unit)]


def running_speed(short: FinishedRun, long: FinishedRun, more_s: float) -> float | None:
    """Axis time per processor time between runs over two recordings; their start-up cancels out.

    Processor time, because elapsed time on a busy machine can be shorter for the longer recording.
    None where even the processor time was: start-up varied by more than the recording took.

    Parameters
    ----------
    short, long : FinishedRun
        The two runs.
    more_s : float
        By how much the long recording is longer, s of axis time.
    """
    extra_s = long.cpu_s - short.cpu_s
    return more_s / extra_s if extra_s > 0.0 else None
