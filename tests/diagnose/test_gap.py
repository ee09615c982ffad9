"""The gap against an independent computation, and without the effects that the machine file has."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from edge_service.cli.entry import main
from edge_service.diagnose.experiment import healthy_session
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Verdict
from edge_service.diagnose.session.session import TORQUE_GAP, TRANSMISSION_GAP
from edge_service.models.machine import EffectConfig, Machine

from .conftest import frame_of, recorded, runs, session_of

RATIO = 0.02 / (2.0 * np.pi)


@pytest.mark.parametrize("causes", [(), ("viscous_error",), ("drag_error", "backlash")])
def test_the_gap_is_that_of_an_independent_computation(
    machine: Machine, causes: tuple[str, ...]
) -> None:
    recording = recorded(causes, seed=3)
    session = session_of(machine, frame_of(recording))
    c = recording.columns
    low = signal.butter(4, 40.0, fs=1000.0, output="sos")
    stretch = signal.sosfiltfilt(low, c["table_position_m"] - RATIO * c["motor_angle_rad"])
    assert session.channels[TRANSMISSION_GAP].rms == pytest.approx(stretch.std(), rel=0.03)
    smooth = signal.butter(4, 100.0, fs=1000.0, output="sos")
    angle = signal.sosfiltfilt(smooth, c["motor_angle_rad"] - c["motor_angle_rad"][0])
    speed = np.gradient(angle, 1e-3)
    model = machine.model
    assert model.preload_drag_nm is not None
    need = model.inertia_kg_m2.value * np.gradient(speed, 1e-3)
    need += model.viscous_nm_s_per_rad.value * speed
    need += model.preload_drag_nm.value * np.sign(speed)
    moving = np.abs(speed) > 0.1
    gap = signal.sosfiltfilt(low, np.where(moving, c["torque_command_nm"] - need, 0.0))
    expected = float(np.sqrt(np.mean(gap[moving] ** 2)))
    assert session.channels[TORQUE_GAP].rms == pytest.approx(expected, rel=0.1)


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
