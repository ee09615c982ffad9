"""Inverse-dynamics identification: the torque that the measured motion needs (IDIM-LS).

torque = J a + D v + F_c sgn(v) + offset (the thesis' one-mass model with the friction of
5.3.12-5.3.15), linear in its parameters, solved for all samples of all runs at once
(Gautier and Khalil, 1988). The published reference for a ball-screw axis is Janot, Gautier and
Brunot, Data Set and Reference Models of EMPS, 2019.
"""

import contextlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..messages.samples import ANGLE, SETPOINT, TORQUE, Floats, SampleFrame
from .interval_estimate import IntervalEstimate, normal_quantile
from .linear import LinearFit, instrumental_variables, least_squares, total_least_squares
from .prepared_run import (
    DECIMATION,
    PreparationSettings,
    PreparedRun,
    derivative_noise_rms,
    prepare,
)

UNITS = {"inertia": "kg m^2", "viscous": "N m s/rad", "coulomb": "N m", "offset": "N m"}
"""Parameters in the order of the regressors: acceleration, speed, direction, one."""
RELIABLE = 0.99
"""Share of signal power in a regressor above which its noise biases the fit by less than 1 %."""
_TOTAL_ROUNDS, _SURE = 5, 0.02
_LEAST_SHARE = 0.1  # of the residual that is the torque's own noise


@dataclass(frozen=True, slots=True, eq=False)
class InverseDynamics:
    """Inverse model of an axis."""

    parameters: Mapping[str, IntervalEstimate]  # by the names of `UNITS`
    fit: LinearFit  # the regression behind it
    method: str  # `least_squares`, `instrumental` or `total`
    seconds: float  # of motion used


def identify_inverse_dynamics(
    recordings: Sequence[SampleFrame], settings: PreparationSettings
) -> InverseDynamics:
    """Inverse model of one axis, with intervals that know of its limits.

    A rigid model of an axis that is not rigid, or of rows that were interpolated, gives other
    parameters when it is filtered otherwise: what they move by with half or quarter of the cutoff
    is systematic, beyond chance (Hausman, 1978). Raises ValueError: too little motion.
    """

    def fitted(share: float) -> InverseDynamics:
        each = replace(settings, cutoff_hz=share * settings.cutoff_hz)
        runs = (prepare(frame, each, beside=(SETPOINT,)) for frame in recordings)
        return fit_inverse_dynamics(run for found in runs for run in found)

    fast, slower = fitted(1.0), [fitted(0.5)]
    with contextlib.suppress(ValueError):
        slower.append(fitted(0.25))
    widened, z = dict(fast.parameters), normal_quantile()
    for name, found in ((k, each) for k, each in fast.parameters.items() if each.determined):
        systematic, others = 0.0, (slow.parameters[name] for slow in slower)
        for k, other in enumerate(others):
            if not other.determined or (k and other.sigma > _SURE * abs(other.value)):
                continue  # what moves too little at a quarter shows nothing
            chance = max(other.sigma**2 - found.sigma**2, 0.0)
            systematic = max((found.value - other.value) ** 2 - z**2 * chance, systematic)
        half = math.hypot(0.5 * (found.high - found.low), z * math.sqrt(systematic))
        widened[name] = replace(found, low=found.value - half, high=found.value + half)
    return replace(fast, parameters=widened)


def fit_inverse_dynamics(runs: Iterable[PreparedRun]) -> InverseDynamics:
    """Inverse model of all runs together.

    Least squares where every regressor is clean; instruments from the commanded motion where one is
    not and setpoints were recorded; total least squares otherwise. Raises ValueError: no run, or
    too little motion.
    """
    designs, torques, instruments = [], [], []
    power, seconds = np.zeros(len(UNITS)), 0.0
    for run in runs:
        designs.append(run.moving_rows(regressors(run.speed_rad_s, run.acceleration_rad_s2)))
        torques.append(run.moving_rows(run.channels[TORQUE]))
        if SETPOINT in run.channels:
            ratio = run.settings.ratio_m_per_rad
            commanded = run.rate(SETPOINT, 1) / ratio, run.rate(SETPOINT, 2) / ratio
            instruments.append(run.moving_rows(regressors(*commanded)))
        noisy = derivative_noise_rms(run, ANGLE, 2), derivative_noise_rms(run, ANGLE, 1)
        power += len(torques[-1]) * np.array([*noisy, 0.0, 0.0]) ** 2
        seconds += len(torques[-1]) * run.period_s * DECIMATION
    if not designs:
        raise ValueError("no unbroken run long enough in the recording")
    design, torque, names = np.concatenate(designs), np.concatenate(torques), tuple(UNITS)
    if len(torque) <= len(names):
        raise ValueError(f"{len(torque)} rows of motion for {len(names)} parameters; record more")
    noise = np.sqrt(power / len(torque))
    signal = np.mean(design**2, axis=0)
    is_noisy = (noise > 0.0) & (signal > 0.0) & (noise**2 > (1.0 - RELIABLE) * signal)
    if is_noisy.any() and len(instruments) == len(designs):
        fit = instrumental_variables(names, design, torque, np.concatenate(instruments))
        method = "instrumental"
    else:
        fit = least_squares(names, design, torque, noise)
        method = "total" if is_noisy.any() else "least_squares"
        if is_noisy.any() and not fit.notes:
            fit = _total(fit, design, torque, noise)
    parameters = {name: fit.interval_estimate(name, unit) for name, unit in UNITS.items()}
    return InverseDynamics(parameters, fit, method, seconds)


def regressors(speed_rad_s: Floats, acceleration_rad_s2: Floats) -> Floats:
    """Columns of the inverse model, (n, 4)."""
    one = np.ones_like(speed_rad_s)
    return np.column_stack([acceleration_rad_s2, speed_rad_s, np.sign(speed_rad_s), one])


def _total(plain: LinearFit, design: Floats, torque: Floats, noise: Floats) -> LinearFit:
    """Total least squares with the torque's noise as what the regressors' leaves of the residual.

    The noise of the torque corrects the coefficients, and they the noise: a few rounds settle it.
    """
    fit = plain
    for _ in range(_TOTAL_ROUNDS):
        left = fit.residual_std**2 - float(np.sum((fit.coefficients * noise) ** 2))
        torque_noise = math.sqrt(max(left, (_LEAST_SHARE * fit.residual_std) ** 2))
        fit = total_least_squares(plain.names, design, torque, noise, torque_noise)
    return fit
