"""Recordings of an axis that shares no code with the library."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.diagnose.session.recordings import runs_of
from edge_service.diagnose.session.session import Session, rigid_baseline
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine
from edge_service.offline.diagnosis import gap
from edge_service.regression.run import Run

from .. import foreign_plant

DURATION_S = 40.0


@cache
def recorded(causes: tuple[str, ...], seed: int, strength: float = 1.0, **more: Any) -> Any:
    effects = tuple((name, strength) for name in causes)
    given = {"seed": seed, "duration_s": DURATION_S, **more}
    return foreign_plant.simulate(foreign_plant.case(effects, "production", **given))


def frame_of(recording: Any, **changes: Any) -> SampleFrame:
    """The recording as one frame; a channel changed, or left out where None."""
    columns = {**recording.columns, **changes}
    time_s = columns.pop("time_s")
    return SampleFrame(time_s, {name: v for name, v in columns.items() if v is not None})


@pytest.fixture(scope="session")
def machine_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("machine") / "machine.toml"
    path.write_text(foreign_plant.nominal_machine_toml(foreign_plant.DIAGNOSIS))
    return path


@pytest.fixture(scope="session")
def machine(machine_file: Path) -> Machine:
    return load_machine(machine_file)


def runs(machine: Machine, frame: SampleFrame) -> list[Run]:
    return list(runs_of([frame], rigid_baseline(machine)))


def session_of(machine: Machine, frame: SampleFrame) -> Session:
    return gap.session_of(machine, runs(machine, frame))


def diagnosed(
    machine_file: Path | str, folder: Path, *traces: str, reference: Sequence[str] = ()
) -> dict[str, Any]:
    """The document that `edge-service diagnose` writes to the folder's `out`."""
    beside = ["--reference", *reference] if reference else []
    given = ["--machine", str(machine_file), *traces, *beside, "--out", str(folder / "out")]
    status = main(["diagnose", *given])
    document: dict[str, Any] = json.loads((folder / "out" / "diagnosis.json").read_text())
    assert status == (3 if document["verdict"] == "bad_data" else 0)
    return document


def torque_gap(machine: Path | str, trace: str, capsys: pytest.CaptureFixture[str]) -> float:
    """The gap in the torque that `edge-service gap` prints, N m."""
    capsys.readouterr()
    assert main(["gap", "--machine", str(machine), trace, "--json"]) == 0
    return float(json.loads(capsys.readouterr().out)["torque_nm"])
