"""Inverse-dynamics identification: the torque that the measured motion needs (IDIM-LS).

torque = J a + D v + F_c sgn(v) + offset (the thesis' one-mass model with the friction of
5.3.12-5.3.15), linear in its parameters, solved for all samples of all runs at once
(Gautier and Khalil, 1988). The published reference for a ball-screw axis is Janot, Gautier and
Brunot, Data Set and Reference Models of EMPS, 2019.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..messages.channels import SETPOINT
from ..messages.samples import Floats, SampleFrame
from .interval_estimate import IntervalEstimate, normal_quantile
from .linear import LinearFit, instrumental_variables, least_squares, total_least_squares
from .prepared_run import PreparationSettings, PreparedRun, prepare
from .regressors import REGRESSORS, SYMMETRIC, RegressionRows, regression_rows

RELIABLE = 0.99
"""Share of signal power in a regressor above which its noise biases the fit by less than 1 %."""

_TOTAL_ROUNDS = 5
_LEAST_SHARE = 0.1  # of the residual that is the torque's own noise


Method = Literal["auto", "least_squares", "instrumental", "total"]


@dataclass(frozen=True, slots=True, eq=False)
class InverseDynamics:
    """IntervalEstimate inverse model.

    Attributes:
        parameters: by name of the regressor.
        fit: the regression behind it.
        method: which estimator it was.
        reliability: share of signal power in each noisy regressor, by its name.
        seconds: of motion used.
    """

    parameters: Mapping[str, IntervalEstimate]
    fit: LinearFit
    method: str
    reliability: Mapping[str, float]
    seconds: float


def identify_inverse_dynamics(
    recordings: Sequence[SampleFrame],
    settings: PreparationSettings,
    names: Sequence[str] = SYMMETRIC,
    method: Method = "auto",
) -> InverseDynamics:
    """Identify the inverse model, with intervals that know of its limits.

    A rigid model of an axis that is not rigid gives other parameters when it is filtered
    otherwise. The fit is repeated with half the cutoff, and what a parameter moves by counts as a
    systematic standard deviation beside the random one, as far as chance does not explain it.

    Args:
        recordings: of one axis, each in its order.

    Raises:
        ValueError: like `fit_inverse_dynamics`.
    """
    slower = replace(settings, cutoff_hz=0.5 * settings.cutoff_hz)
    fast, slow = (
        fit_inverse_dynamics(
            (run for frame in recordings for run in prepare(frame, each)), names, method
        )
        for each in (settings, slower)
    )
    widened = {
        name: _widened(found, slow.parameters[name]) for name, found in fast.parameters.items()
    }
    return replace(fast, parameters=widened)


def _widened(found: IntervalEstimate, other: IntervalEstimate) -> IntervalEstimate:
    """`found`, wider by its distance from `other` beyond what chance allows.

    `other` leaves out data that `found` has, so the variance of their difference is that of the
    variances (Hausman, 1978).
    """
    if not found.determined or not other.determined:
        return found
    chance = max(other.sigma**2 - found.sigma**2, 0.0)
    systematic = max((found.value - other.value) ** 2 - normal_quantile() ** 2 * chance, 0.0)
    half = math.hypot(0.5 * (found.high - found.low), normal_quantile() * math.sqrt(systematic))
    return replace(found, low=found.value - half, high=found.value + half)


def fit_inverse_dynamics(
    runs: Iterable[PreparedRun],
    names: Sequence[str] = SYMMETRIC,
    method: Method = "auto",
) -> InverseDynamics:
    """Identify the inverse model from all runs together.

    `auto` takes least squares where every regressor is clean, instruments from the commanded
    motion where one is not and setpoints were recorded, and total least squares otherwise.

    Raises:
        ValueError: one line; an unknown regressor, too little motion, or a method whose channels
            are missing.
    """
    rows = regression_rows(runs, names)
    if len(rows.torque_nm) <= len(names):
        raise ValueError(
            f"{len(rows.torque_nm)} rows of motion for {len(names)} parameters; record more"
        )
    power, noise = np.mean(rows.design**2, axis=0), rows.noise_rms
    reliability = {
        name: 1.0 - min(float(noise[k] ** 2 / power[k]), 1.0)
        for k, name in enumerate(names)
        if noise[k] > 0.0 and power[k] > 0.0
    }
    chosen = _chosen(method, rows, reliability)
    fit = _fitted(chosen, rows, names)
    return InverseDynamics(
        {name: fit.interval_estimate(name, REGRESSORS[name].unit) for name in names},
        fit,
        chosen,
        reliability,
        rows.seconds,
    )


def _chosen(method: Method, rows: RegressionRows, reliability: Mapping[str, float]) -> str:
    if method == "instrumental" and rows.instruments is None:
        raise ValueError(f"instruments need {SETPOINT}, which the recording lacks")
    if method != "auto":
        return method
    if min(reliability.values(), default=1.0) >= RELIABLE:
        return "least_squares"
    return "total" if rows.instruments is None else "instrumental"


def _fitted(method: str, rows: RegressionRows, names: Sequence[str]) -> LinearFit:
    if method == "instrumental" and rows.instruments is not None:
        return instrumental_variables(names, rows.design, rows.torque_nm, rows.instruments)
    plain = least_squares(names, rows.design, rows.torque_nm, rows.noise_rms)
    if method == "total" and not plain.notes:
        return _total(plain, rows.design, rows.torque_nm, rows.noise_rms)
    return plain


def _total(plain: LinearFit, design: Floats, torque: Floats, noise: Floats) -> LinearFit:
    """Total least squares with the torque's noise as what the regressors' leaves of the residual.

    The coefficients say how much of the residual is the regressors' noise, and the noise of the
    torque corrects the coefficients: a few rounds settle it.
    """
    fit = plain
    for _ in range(_TOTAL_ROUNDS):
        left = fit.residual_std**2 - float(np.sum((fit.coefficients * noise) ** 2))
        torque_noise = math.sqrt(max(left, (_LEAST_SHARE * fit.residual_std) ** 2))
        fit = total_least_squares(plain.names, design, torque, noise, torque_noise)
    return fit
