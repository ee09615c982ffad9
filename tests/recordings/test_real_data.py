"""Recordings made by others, read through the machine files that come with the service."""

import csv
import tomllib
from pathlib import Path

import numpy as np
import pytest

from edge_service.models.machine import Machine
from edge_service.recordings.reader import read_trace

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
EMPS = DATA / "emps" / "emps_estimation.csv"


def _machine(name: str) -> Machine:
    return Machine.model_validate(tomllib.loads((ROOT / "deploy" / name).read_text()))


def _column(path: Path, name: str) -> list[float]:
    with path.open(newline="") as file:
        return [float(row[name]) for row in csv.DictReader(file)]


@pytest.mark.skipif(not EMPS.exists(), reason="the EMPS recordings are not here")
def test_emps_rows_duration_force_and_position() -> None:
    machine = _machine("emps.toml")
    frame = read_trace(EMPS, machine.columns)
    assert len(frame) == 24_841
    assert frame.time_s[-1] - frame.time_s[0] == pytest.approx(24.84, abs=1e-6)
    ratio = machine.transmission_ratio_m_per_rad
    force_n = frame.channels["torque_command_nm"] / ratio
    volts = np.array(_column(EMPS, "u_V"))
    np.testing.assert_allclose(force_n, 35.15065 * volts, rtol=1e-6)
    position_m = frame.channels["motor_angle_rad"] * ratio
    np.testing.assert_allclose(position_m, _column(EMPS, "q_meas_m"), rtol=1e-7)
