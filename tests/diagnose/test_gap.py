"""The gap against an independent computation, and without the effects that the machine file has."""

import json
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.diagnose.experiment import healthy_session
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Verdict
from edge_service.diagnose.session.session import TORQUE_GAP, TRANSMISSION_GAP
from edge_service.models.machine import EffectConfig, Machine

from .. import foreign_plant
from .conftest import frame_of, recorded, runs, session_of


@pytest.mark.parametrize("causes", [(), ("viscous_error",), ("drag_error", "backlash")])
def test_gap_is_that_of_independent_computation(machine: Machine, causes: tuple[str, ...]) -> None:
    recording = recorded(causes, seed=3)
    expected = foreign_plant.gap(recording, foreign_plant.DIAGNOSIS)
    channels = session_of(machine, frame_of(recording)).channels
    for name, tolerance in ((TRANSMISSION_GAP, 0.03), (TORQUE_GAP, 0.1)):
        assert channels[name].rms == pytest.approx(expected[name], rel=tolerance)


def test_the_command_prints_one_json_object(
    machine: Machine, machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = recorded((), seed=3).write_csv(tmp_path / "a.csv")
    assert main(["gap", "--machine", str(machine_file), str(trace), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    session = session_of(machine, frame_of(recorded((), seed=3)))
    assert printed == {
        name: pytest.approx(rows.rms, rel=1e-3) for name, rows in session.channels.items()
    }
    assert main(["gap", "--machine", str(machine_file), str(trace)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[2:] for line in said] == [["N", "m"], ["µm"]]


MODELLED = (
    *("backlash", "compliance", "drag_error", "encoder_eccentricity", "inertia_error"),
    *("lead_error", "stribeck", "timestamp_skew", "torque_ripple", "viscous_error"),
)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELLED)
def test_what_the_machine_file_has_is_not_named_again(machine: Machine, name: str) -> None:
    knowing = machine.model_copy(update={"effects": (EffectConfig(name=name),)})
    motion = runs(machine, frame_of(recorded((), 3)))
    session = healthy_session(knowing, motion)
    found = diagnose_session(session, knowing)
    assert name not in {each.name for each in found.effects if each.probability > 0.5}
    assert found.verdict in (Verdict.NO_GAP, Verdict.UNKNOWN)
