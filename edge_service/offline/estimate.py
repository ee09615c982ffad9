"""The same way through the house without a bus: a recording in, estimates out."""

import csv
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np

from ..atomic import replaced_file, write_whole
from ..command_answer import Answer
from ..config import ConfigError, EstimatorConfig, load_machine
from ..estimate.one_encoder import OneEncoderEstimator
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from ..nodes.estimated_axis import DAMAGED, LONGEST_STOP_S, Kept, StateError, identity_of
from ..nodes.stages import make_downsampler, make_estimator
from ..recordings.conditioning import MAX_ROWS
from ..recordings.reader import ASKED, joined
from .recordings import examine, open_recording, reported, require_sound

_NUMBERS = ("time_s", "preload_percent", "low", "high")
COLUMNS = (*_NUMBERS, "status", "drag_torque_nm", "reasons", "method")


class OfflineEstimate:
    """The stages of one axis; goes on from a state file and leaves one."""

    def __init__(self, machine: Machine, config: EstimatorConfig) -> None:
        self._machine, self._identity = machine, identity_of(machine, config)
        self._downsampler = make_downsampler(machine)
        self._estimator = make_estimator(config, machine)
        self._end_s, self._restored = 0.0, False

    def restore(self, path: Path) -> None:
        """Go on from a file, if it is there. Raises ConfigError if it is no state of this axis."""
        try:
            if path.exists():
                document = json.loads(path.read_bytes())
                kept = Kept.of(document, self._machine.axis.name, self._identity)
                self._downsampler.restore(kept.snapshot["downsampler"])
                self._estimator.restore(kept.snapshot["estimator"])
                self._end_s, self._restored = kept.time_s, True
        except (StateError, OSError, *DAMAGED) as error:
            raise ConfigError(f"--state {path}: cannot be resumed: {error}") from None

    def keep(self, path: Path) -> None:
        stages = (("downsampler", self._downsampler), ("estimator", self._estimator))
        snapshot = {name: stage.snapshot() for name, stage in stages}
        document = Kept(self._end_s, 0, snapshot).document(self._machine.axis.name, self._identity)
        write_whole(path, json.dumps(document))

    def of_test(self, trace: Path) -> PreloadEstimate | None:
        """Estimate by a test in a recording; None without one. Raises ValueError: of no use."""
        if not isinstance(self._estimator, OneEncoderEstimator):
            return None
        from ..fingerprint.response.notch import notch_of  # 0.2 s that other axes do without

        frames = list[SampleFrame]()
        with open_recording(self._machine, trace) as reader:
            for frame in reader:
                frames.append(frame)
                if sum(map(len, frames)) > MAX_ROWS:
                    return None
        whole = joined(frames) if frames else None
        if whole is None or (notch := notch_of(whole)) is None:
            return None
        self._end_s = float(np.fmax.reduce(whole.time_s))
        return self._estimator.take_test(notch, self._end_s)

    def estimates(self, frames: Iterable[SampleFrame]) -> Iterator[PreloadEstimate]:
        """One estimate per completed interval, as the service would publish it."""
        for frame in frames:
            if self._restored and len(frame):
                self._restored = False
                if np.fmin.reduce(frame.time_s) <= self._end_s:  # on a clock of its own
                    self._downsampler = make_downsampler(self._machine)
                    self._estimator.resume(LONGEST_STOP_S)
            for block in self._downsampler.push(frame):
                self._end_s = block.time_s
                self._estimator.update(block)
                yield self._estimator.estimate()


def estimate_to_csv(
    trace: Path,
    machine_file: Path,
    out: Path,
    config: EstimatorConfig,
    state: Path | None = None,
    axis_number: int | None = None,
) -> Answer:
    """Write the estimates of a trace; a state that is there is gone on from, and left behind.

    Raises ConfigError, TraceError, ExaminationError.
    """
    for given in (trace, machine_file, *(() if state is None else (state,))):
        if out.resolve() == given.resolve():
            raise ConfigError(f"--out {out}: would overwrite its own input; choose another file")
    if state is not None and state.resolve() in (trace.resolve(), machine_file.resolve()):
        raise ConfigError(f"--state {state}: would overwrite an input; choose another file")
    machine = load_machine(machine_file, axis_number)
    require_sound(examine(machine, [trace], ASKED), [trace])
    offline = OfflineEstimate(machine, config)
    if state is not None:
        offline.restore(state)
    rows, last, refused = 0, None, ""
    try:
        tested = offline.of_test(trace)
    except ValueError as error:
        tested, refused = None, f"; the test says nothing: {error}"
    with open_recording(machine, trace) as frames, replaced_file(out) as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        live = offline.estimates(reported(frames, f"estimating {trace.name}"))
        for last in live if tested is None else (tested,):
            rows += 1
            drag_nm = None if last.drag_torque_nm is None else last.drag_torque_nm.value
            numbers = (last.time_s, last.preload_percent, last.low, last.high)
            reasons = " ".join(reason.partition(":")[0] for reason in last.reasons)
            writer.writerow((*numbers, last.status.value, drag_nm, reasons, last.method))
        if state is not None:
            offline.keep(state)
    ending = "none" if last is None else last.status.value
    if last is not None and last.status is not EstimateStatus.ESTIMATED:
        ending += f" ({'; '.join(last.reasons)})"
    told = {"out": str(out), "blocks": rows, "last": last}
    by = " by a test of shaking" if tested else refused
    return Answer(f"{out}: {rows} blocks, last status {ending}{by}", told)


def estimate_case(
    machine_file: Path,
    traces: Sequence[Path],
    out_dir: Path,
    config: EstimatorConfig,
    axis_number: int | None = None,
) -> Answer:
    """Write `estimates.csv` of the one recording of a case; errors as `estimate_to_csv`."""
    if len(traces) > 1:
        raise ConfigError(f"{out_dir.name}: estimate takes one recording a case, not a folder")
    out = out_dir / "estimates.csv"
    return estimate_to_csv(traces[0], machine_file, out, config, axis_number=axis_number)
