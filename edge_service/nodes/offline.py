"""The same way through the house without a bus: a recording in, estimates out."""

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..atomic import replaced_file
from ..config import ConfigError, EdgeConfig, load_machine
from ..messages.estimate import PreloadEstimate
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..trace.reader import open_trace
from .columns import column_maps
from .convert import controller_axis
from .pipeline import make_downsampler, make_estimator

COLUMNS = ("time_s", "preload_percent", "low", "high", "status", "drag_torque_nm")


def estimates(
    frames: Iterable[SampleFrame], machine: Machine, config: EdgeConfig
) -> Iterator[PreloadEstimate]:
    """One estimate per completed interval, as the service would publish it."""
    downsampler = make_downsampler(config.downsample, machine)
    estimator = make_estimator(config.estimator, machine)
    for frame in frames:
        for block in downsampler.push(frame):
            estimator.update(block)
            yield estimator.estimate()


def estimate_to_csv(trace: Path, machine_file: Path, out: Path, config: EdgeConfig) -> str:
    """Write the estimates of a trace; returns a line that says what was written."""
    for given in (trace, machine_file):
        if out.resolve() == given.resolve():
            raise ConfigError(f"--out {out}: would overwrite its own input; choose another file")
    machine = load_machine(machine_file)
    rows = 0
    last: PreloadEstimate | None = None
    with (
        open_trace(trace, column_maps(machine), controller_axis(machine)) as frames,
        replaced_file(out) as file,
    ):
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        for last in estimates(frames, machine, config):
            rows += 1
            drag = last.drag_torque_nm
            writer.writerow(
                [
                    repr(last.time_s),
                    last.preload_percent,
                    last.low,
                    last.high,
                    last.status.value,
                    None if drag is None else drag.value,
                ]
            )
    return f"{out}: {rows} blocks, last status {last.status.value if last else 'none'}"
