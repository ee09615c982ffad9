"""Modes and inertia of a response that a control has measured, against a chain of three masses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edge_service.fingerprint.response.control_response import (
    measure_control_response,
    relative_error,
)
from edge_service.fingerprint.response.frequency_response import FrequencyResponse

COUNT = 200
FREQUENCY = np.geomspace(2.0, 2000.0, COUNT)
MOTOR, TABLE, STIFFNESS = 0.08, 0.06, 4000.0
NOTCH_HZ = math.sqrt(STIFFNESS / TABLE) / (2.0 * math.pi)
PEAK_HZ = NOTCH_HZ * math.sqrt(1.0 + TABLE / MOTOR)


def chain(masses: list[float], springs: list[float], damping: float = 0.02) -> np.ndarray:
    """Speed over torque of the first of masses in a row, by solving for each frequency."""
    inertia = np.diag(masses).astype(complex)
    stiffness = np.zeros_like(inertia)
    for k, spring in enumerate(springs):
        stiffness[k : k + 2, k : k + 2] += spring * np.array([[1, -1], [-1, 1]])
    found = []
    for frequency in FREQUENCY:
        s = 2j * math.pi * frequency
        springy = stiffness * (1.0 + 1j * damping)
        angles = np.linalg.solve(s**2 * inertia + springy, np.eye(len(masses))[0])
        found.append(s * angles[0])
    return np.array(found)


def measured(response: np.ndarray, noise: float = 1e-3, seed: int = 1) -> FrequencyResponse:
    draw = np.random.default_rng(seed)
    noisy = response * (1.0 + noise * (draw.normal(size=COUNT) + 1j * draw.normal(size=COUNT)))
    averages = 20.0
    coherence = np.full(COUNT, 1.0 / (1.0 + 2.0 * averages * noise**2))
    error = relative_error(coherence, averages)
    np.testing.assert_allclose(error, noise, rtol=1e-9)
    return FrequencyResponse(FREQUENCY, noisy, error, coherence)


TWO = chain([MOTOR, TABLE], [STIFFNESS])
RINGING = chain([MOTOR / 2, MOTOR / 2, TABLE], [2e6, STIFFNESS])


@pytest.mark.parametrize("response", [TWO, RINGING], ids=("two masses", "another mode above"))
def test_inertias_and_spring_are_those_of_the_chain(response: np.ndarray) -> None:
    figures, curves = measure_control_response(measured(response), speed_over_torque=True)
    truth = {
        "antiresonance_hz": NOTCH_HZ,
        "resonance_hz": PEAK_HZ,
        "table_share": TABLE / (MOTOR + TABLE),
        "response_inertia_kg_m2": MOTOR + TABLE,
        "motor_inertia_kg_m2": MOTOR,
        "load_inertia_kg_m2": TABLE,
        "stiffness_nm_per_rad": STIFFNESS,
    }
    for name, true in truth.items():
        assert figures[name].value == pytest.approx(true, rel=0.02), name
    assert [curve.name for curve in curves] == ["measured", "fit"]


@pytest.mark.parametrize("seed", range(4))
def test_intervals_hold_the_truth_where_two_masses_are_all(seed: int) -> None:
    figures, _ = measure_control_response(measured(TWO, 0.01, seed), speed_over_torque=True)
    held = [
        figures["response_inertia_kg_m2"].holds(MOTOR + TABLE),
        figures["antiresonance_hz"].holds(NOTCH_HZ),
        figures["resonance_hz"].holds(PEAK_HZ),
    ]
    assert sum(held) >= 2


def test_what_other_modes_leave_widens_the_intervals() -> None:
    """Two masses cannot be the whole of an axis that sways: the rest is not noise."""
    swaying = TWO * (1.0 + 0.05 * np.sin(3.0 * np.log(FREQUENCY)))
    plain, _ = measure_control_response(measured(TWO), speed_over_torque=True)
    wide, _ = measure_control_response(measured(swaying), speed_over_torque=True)
    name = "response_inertia_kg_m2"
    assert wide[name].sigma > 3.0 * plain[name].sigma
    assert wide[name].n_effective < 0.6 * plain[name].n_effective


def test_a_rigid_axis_has_an_inertia_and_no_modes() -> None:
    rigid = 1.0 / (2j * math.pi * FREQUENCY * (MOTOR + TABLE))
    figures, _ = measure_control_response(measured(rigid), speed_over_torque=True)
    assert figures["response_inertia_kg_m2"].value == pytest.approx(MOTOR + TABLE, rel=0.01)
    assert figures["response_inertia_kg_m2"].holds(MOTOR + TABLE)
    assert not math.isfinite(figures["antiresonance_hz"].value)
    assert "motor_inertia_kg_m2" not in figures


def test_what_is_no_response_of_a_mass_is_refused() -> None:
    for gain, reason in ((8.0, "3[0-9] degrees late.*loop is closed"), (100.0, "power -0.34")):
        closed_loop = gain * TWO / (1.0 + gain * TWO)  # a controller in proportion to the speed
        with pytest.raises(ValueError, match=f"no response of speed to torque.*{reason}"):
            measure_control_response(measured(closed_loop), speed_over_torque=True)
    with pytest.raises(ValueError, match="coherent frequencies"):
        incoherent = replace(measured(TWO), coherence=np.zeros(COUNT))
        measure_control_response(incoherent, speed_over_torque=True)
