"""`edge-service gap`: how far model and machine are apart, in one number per channel."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from ..config import load_machine
from ..diagnose.recorded import Run, runs_of
from ..diagnose.session import Session
from ..diagnose.twin import rigid_baseline
from ..messages.samples import SampleFrame
from ..models.effects.registry import machine_effects
from ..models.machine import Machine
from ..nodes.columns import column_maps
from ..nodes.convert import controller_axis
from ..trace.reader import open_trace


class DiagnosisError(Exception):
    """Recordings or a machine that cannot be compared; the text is one line."""


def gap(machine_file: Path, traces: Sequence[Path]) -> dict[str, float]:
    """Root mean square gap by channel.

    Raises:
        ConfigError: the machine file is wrong.
        TraceError: a recording cannot be read.
        DiagnosisError: the recordings hold no motion to compare.
    """
    machine = load_machine(machine_file)
    session = session_of(machine, read_runs(machine, traces))
    return {name: rows.rms for name, rows in session.channels.items()}


def read_runs(machine: Machine, traces: Sequence[Path]) -> list[Run]:
    """Filtered runs of all recordings, read in bounded pieces."""
    if not traces:
        raise DiagnosisError("no recording given; expected one trace or more")
    try:
        baseline = rigid_baseline(machine)
        with ExitStack() as stack:
            return list(runs_of(_opened(stack, machine, traces), baseline))
    except ValueError as error:
        raise DiagnosisError(str(error)) from error


def _opened(
    stack: ExitStack, machine: Machine, traces: Sequence[Path]
) -> Iterator[Iterator[SampleFrame]]:
    maps, axis = column_maps(machine), controller_axis(machine)
    for path in traces:
        yield stack.enter_context(open_trace(path, maps, axis))


def session_of(machine: Machine, runs: Sequence[Run]) -> Session:
    """The session of runs that hold motion."""
    session = Session.of_runs(runs, rigid_baseline(machine), machine_effects(machine))
    if not session.channels or not all(len(rows.gap) for rows in session.channels.values()):
        raise DiagnosisError(
            "nothing to compare: expected a second or more of motion with a torque or both encoders"
        )
    return session
