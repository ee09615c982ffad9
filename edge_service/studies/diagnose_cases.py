"""Sealed recordings of the foreign plant, and how the diagnosis is asked about them."""

import importlib
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..config import load_machine
from ..diagnose.diagnosis import Diagnosis, diagnose_session
from ..diagnose.recorded import runs_of
from ..diagnose.session import Session
from ..diagnose.twin import rigid_baseline
from ..messages.samples import Floats, SampleFrame
from ..models.effects.registry import effects
from ..models.machine import Machine

"""Fewer than a diagnosis takes: only their median is used."""


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


class BenchError(Exception):
    """The bench cannot be run; the text is one line."""


def foreign_plant(root: Path | None = None) -> Any:
    """The truth generator beside the tests of a checkout."""
    tests = (root or Path(__file__).parents[2]) / "tests"
    if not (tests / "foreign_plant").is_dir():
        raise BenchError(f"no foreign_plant in {tests}: the bench runs from a checkout")
    if str(tests) not in sys.path:
        sys.path.insert(0, str(tests))
    return importlib.import_module("foreign_plant")


def baseline_machine() -> Machine:
    """Content of the machine file of the foreign axis."""
    plant = foreign_plant()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "machine.toml"
        path.write_text(plant.nominal_machine_toml(plant.DIAGNOSIS), "utf-8")
        return load_machine(path)


def recorded(
    case: BenchCase, motion: str | Floats, seed: int, elapsed_s: float = 0.0
) -> SampleFrame:
    """A recording of the axis of a case; a motion by its name, or positions at 1 kHz."""
    plant = foreign_plant()
    effects_there = tuple((name, case.strength) for name in case.causes)
    recording = plant.simulate(
        plant.case(effects_there, motion, seed=seed, axis_seed=case.seed, elapsed_s=elapsed_s)
    )
    columns = dict(recording.columns)
    return SampleFrame(columns.pop("time_s"), columns)


def session_of_frames(machine: Machine, frames: Sequence[SampleFrame]) -> Session:
    """The session of some recordings of one axis."""
    baseline = rigid_baseline(machine)
    return Session.of_runs(runs_of(frames, baseline), baseline)


def diagnosed(machine: Machine, session: Session, withheld: Sequence[str] = ()) -> Diagnosis:
    """The answer to a session; what is there, and how strong, is not told."""
    library = [each for each in effects().values() if each.name not in withheld]
    return diagnose_session(session, machine, library)
