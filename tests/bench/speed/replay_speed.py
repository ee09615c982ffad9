"""Speed of a recording through the service and the estimator, as a multiple of real time."""

import re
from pathlib import Path

from ..identification.simulated_axis import write_recording
from ..table import BenchError, Figure
from .process_meter import ServiceProcess

SHORT_S = 5.0
_PATIENCE_S = 300.0
_COUNTED = re.compile(r"(\d+) (?:estimates|blocks)\b")


def replay_figures(folder: Path, kernels: Path, recording_s: float) -> list[Figure]:
    """Axis time per processor time of `replay --speed 0` and `estimate`, and what was lost.

    The start-up of a recording of 5 s and of one of `recording_s` cancel out. Processor time,
    because elapsed time on a busy machine can be shorter for the longer one.
    """
    traces = [folder / "short.csv", folder / "long.csv"]
    for trace, duration_s in zip(traces, (SHORT_S, recording_s), strict=True):
        write_recording(trace, duration_s)

    def run(*arguments: str) -> tuple[float, str]:
        with ServiceProcess(arguments, folder, kernels) as process:
            return process.wait_for_end(_PATIENCE_S)

    traces.insert(0, traces[0])  # for the kernels
    replays = [run("replay", str(trace), "--speed", "0", "--port", "0") for trace in traces]
    estimates = [run("estimate", str(each), "--out", f"{folder}/out.csv") for each in traces]
    figures = []
    for name, (_, short, long), aim in (
        ("a recording flat out through all nodes, per core", replays, 150.0),
        ("`estimate` over a recording, per core", estimates, 500.0),
    ):
        if long[0] > short[0]:  # else start-up varied by more than the recording took
            speed = (recording_s - SHORT_S) / (long[0] - short[0])
            figures.append(Figure(name, speed, "x real time", at_least=aim))
    lost = estimate_count(estimates[2][1]) - estimate_count(replays[2][1])
    return [*figures, Figure("intervals lost flat out", lost, "", at_most=0.0)]


def estimate_count(output: str) -> int:
    """Number of estimates that `replay` or `estimate` says it made."""
    found = _COUNTED.search(output)
    if found is None:
        raise BenchError(f"no count of estimates in {output.strip()!r}")
    return int(found[1])
