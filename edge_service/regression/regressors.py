"""The columns of the inverse model, and their rows from prepared runs."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..messages.channels import ANGLE, SETPOINT, TORQUE
from ..messages.samples import Floats
from .prepared_run import PreparedRun, derivative_noise_rms


@dataclass(frozen=True, slots=True, eq=False)
class MotorMotion:
    """Motion at the motor, before decimation: all (n,)."""

    angle_rad: Floats
    speed_rad_s: Floats
    acceleration_rad_s2: Floats
    period_s: float


@dataclass(frozen=True, slots=True)
class Regressor:
    """One column of the inverse model.

    Attributes:
        unit: of its coefficient, for a torque in N m.
        column: motion -> values, (n,).
        derivative: how many times the angle is differentiated in it; its noise follows from that.
    """

    unit: str
    column: Callable[[MotorMotion], Floats]
    derivative: int = 0


def _forward(motion: MotorMotion) -> Floats:
    return np.where(motion.speed_rad_s > 0.0, 1.0, 0.0)


def _backward(motion: MotorMotion) -> Floats:
    return np.where(motion.speed_rad_s < 0.0, 1.0, 0.0)


REGRESSORS: Mapping[str, Regressor] = {
    "inertia": Regressor("kg m^2", lambda motion: motion.acceleration_rad_s2, 2),
    "viscous": Regressor("N m s/rad", lambda motion: motion.speed_rad_s, 1),
    "coulomb": Regressor("N m", lambda motion: np.sign(motion.speed_rad_s)),
    "offset": Regressor("N m", lambda motion: np.ones_like(motion.speed_rad_s)),
    "viscous_forward": Regressor(
        "N m s/rad", lambda motion: _forward(motion) * motion.speed_rad_s, 1
    ),
    "viscous_backward": Regressor(
        "N m s/rad", lambda motion: _backward(motion) * motion.speed_rad_s, 1
    ),
    "coulomb_forward": Regressor("N m", _forward),
    "coulomb_backward": Regressor("N m", lambda motion: -_backward(motion)),
}
"""Columns by name."""

SYMMETRIC = ("inertia", "viscous", "coulomb", "offset")
DIRECTIONAL = (
    "inertia",
    "viscous_forward",
    "viscous_backward",
    "coulomb_forward",
    "coulomb_backward",
)
"""Friction that differs by direction; an offset is then part of the two Coulomb levels."""


@dataclass(frozen=True, slots=True, eq=False)
class RegressionRows:
    """Decimated rows of motion, of all runs together.

    Attributes:
        design: regressors from the measured motion, (n, p).
        torque_nm: (n,).
        instruments: the same regressors from the commanded motion, (n, p); None where a run has
            no setpoints.
        noise_rms: noise in each regressor from that of the angle, (p,).
        seconds: of motion.
    """

    design: Floats
    torque_nm: Floats
    instruments: Floats | None
    noise_rms: Floats
    seconds: float


def regression_rows(runs: Iterable[PreparedRun], names: Sequence[str]) -> RegressionRows:
    """Regressors and torque of all moving rows; holds one run at a time beside them.

    Raises:
        ValueError: one line; an unknown regressor, or no run at all.
    """
    for name in names:
        if name not in REGRESSORS:
            raise ValueError(f"no regressor {name!r}; there are {', '.join(REGRESSORS)}")
    designs, torques, instruments = [], [], []
    power, seconds = np.zeros(len(names)), 0.0
    for run in runs:
        designs.append(run.moving_rows(_columns(_measured(run), names)))
        torques.append(run.moving_rows(run.channels[TORQUE]))
        if SETPOINT in run.channels:
            instruments.append(run.moving_rows(_columns(_commanded(run), names)))
        power += len(torques[-1]) * _noise_rms(run, names) ** 2
        seconds += len(torques[-1]) * run.period_s * run.settings.decimation
    if not designs:
        raise ValueError("no unbroken run long enough in the recording")
    torque = np.concatenate(torques)
    return RegressionRows(
        np.concatenate(designs),
        torque,
        np.concatenate(instruments) if len(instruments) == len(designs) else None,
        np.sqrt(power / max(len(torque), 1)),
        seconds,
    )


def _columns(motion: MotorMotion, names: Sequence[str]) -> Floats:
    return np.column_stack([REGRESSORS[name].column(motion) for name in names])


def _measured(run: PreparedRun) -> MotorMotion:
    return MotorMotion(run.channels[ANGLE], run.speed_rad_s, run.acceleration_rad_s2, run.period_s)


def _commanded(run: PreparedRun) -> MotorMotion:
    ratio = run.settings.ratio_m_per_rad
    return MotorMotion(
        run.channels[SETPOINT] / ratio,
        run.rate(SETPOINT, 1) / ratio,
        run.rate(SETPOINT, 2) / ratio,
        run.period_s,
    )


def _noise_rms(run: PreparedRun, names: Sequence[str]) -> Floats:
    """Noise in each regressor from that of the angle, (p,)."""
    orders = [REGRESSORS[name].derivative for name in names]
    by_order = {order: derivative_noise_rms(run, ANGLE, order) for order in set(orders) - {0}}
    return np.array([by_order.get(order, 0.0) for order in orders])
