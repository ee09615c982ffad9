"""Recordings made by others, read through the machine files that come with the service."""

import csv
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from edge_service.models.machine import Machine
from edge_service.recordings.reader import read_trace

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
EMPS = DATA / "emps" / "emps_estimation.csv"
MILL = DATA / "smart_cnc_mill" / "experiment_06.csv"


def _machine(name: str) -> Machine:
    return Machine.model_validate(tomllib.loads((ROOT / "deploy" / name).read_text()))


def _column(path: Path, name: str) -> list[float]:
    with path.open(newline="") as file:
        return [float(row[name]) for row in csv.DictReader(file)]


def test_emps_model_is_the_published_one_at_the_motor_shaft() -> None:
    machine = _machine("emps.toml")
    ratio = machine.transmission_ratio_m_per_rad
    assert machine.model.inertia_kg_m2.value / ratio**2 == pytest.approx(95.1089, rel=1e-6)
    assert machine.model.viscous_nm_s_per_rad.value / ratio**2 == pytest.approx(203.5034, rel=1e-6)
    assert machine.axis.max_torque_nm is not None
    assert machine.axis.max_torque_nm / ratio == pytest.approx(351.5065, rel=1e-6)
    assert machine.axis.dynamic_load_rating_n is None


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


@pytest.mark.skipif(not MILL.exists(), reason="the recordings of the mill are not here")
def test_mill_without_times_runs_at_ten_hertz() -> None:
    frame = read_trace(MILL, _machine("cnc_mill.toml").columns)
    assert len(frame) == 1296
    np.testing.assert_allclose(np.diff(frame.time_s), 0.1)
    assert frame.channels["table_position_m"].min() == pytest.approx(0.141)
    assert frame.channels["table_speed_m_s"].max() == pytest.approx(0.045)
    current = np.array(_column(MILL, "X1_CurrentFeedback"))
    force_n = frame.channels["torque_command_nm"] * 2.0 * math.pi / 0.010
    np.testing.assert_allclose(force_n, 38.0 * current, rtol=1e-3)
