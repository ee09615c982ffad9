"""Sealed recordings of the foreign plant, and how the diagnosis is asked about them."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from edge_service.cli.options import InputError
from edge_service.config import load_machine
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Diagnosis
from edge_service.diagnose.session.recordings import runs_of
from edge_service.diagnose.session.session import Session
from edge_service.diagnose.session.twin import rigid_baseline
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.registry import effects
from edge_service.models.machine import Machine

from ... import foreign_plant


@dataclass(frozen=True, slots=True)
class BenchCase:
    """One sealed recording to diagnose."""

    causes: tuple[str, ...]
    strength: float
    motion: str
    seed: int
    withheld: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Short name of the case."""
        return f"{'+'.join(self.causes) or 'healthy'} x{self.strength:g} {self.motion} {self.seed}"


class BenchError(InputError):
    """The bench cannot be run; the text is one line."""


def baseline_machine() -> Machine:
    """Content of the machine file of the foreign axis."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "machine.toml"
        path.write_text(foreign_plant.nominal_machine_toml(foreign_plant.DIAGNOSIS), "utf-8")
        return load_machine(path)


def recorded(
    case: BenchCase, motion: str | Floats, seed: int, elapsed_s: float = 0.0
) -> SampleFrame:
    """A recording of the axis of a case; a motion by its name, or positions at 1 kHz."""
    effects_there = tuple((name, case.strength) for name in case.causes)
    recording = foreign_plant.simulate(
        foreign_plant.case(
            effects_there, motion, seed=seed, axis_seed=case.seed, elapsed_s=elapsed_s
        )
    )
    columns = dict(recording.columns)
    return SampleFrame(columns.pop("time_s"), columns)


def session_of_frames(machine: Machine, frames: Sequence[SampleFrame]) -> Session:
    """The session of some recordings of one axis."""
    baseline = rigid_baseline(machine)
    return Session.of_runs(runs_of(frames, baseline), baseline)


def diagnosed(machine: Machine, session: Session, withheld: Sequence[str] = ()) -> Diagnosis:
    """The answer to a session; without a word on what is there, or how strong."""
    library = [each for each in effects().values() if each.name not in withheld]
    return diagnose_session(session, machine, library)
