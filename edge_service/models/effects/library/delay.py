"""A torque that comes late."""

from collections.abc import Iterator

import numpy as np

from ....messages.samples import Floats
from ..baseline import Baseline, Motion
from ..contribution import Change, Constant
from ..effect import ACCELERATION_HZ, MATERIAL_TOLERANCES, Effect, Kind, Term, Trace, amount
from ..empirical import Covered, EmpiricalForm

_CURRENT_LOOP_S, _STAMPED_S = 3e-4, 1e-4
"""Assumption: no current loop answers later, and no torque is stamped less exactly."""


def _healthy_lag(period_s: float, _coulomb_nm: float) -> tuple[float, float]:
    """Mean and standard deviation of the lag, s.

    A torque may be recorded as it acts, or as a command that is held for a period and acts half a
    period late, behind a current loop of a few tenths of a millisecond.
    """
    latest_s = 0.5 * period_s + _CURRENT_LOOP_S
    return 0.5 * latest_s, (0.5 * latest_s + _STAMPED_S) / MATERIAL_TOLERANCES


def _empirical_forms(_covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    """A lag behind that of a healthy drive: their product bends the torque."""
    yield EmpiricalForm("behind", (_bend,))


def _bend(motion: Motion, _baseline: Baseline) -> Floats:
    slope = np.gradient(motion.model_torque_nm, motion.time_s)
    return np.asarray(np.gradient(slope, motion.time_s))


EFFECT = Effect(
    name="delay",
    description="The torque follows its command late: a slow current loop, or a filter too strong.",
    source="first-order lag: command = torque + T d torque / dt",
    kind=Kind.DRIVE,
    parameters=(amount("lag_s", "s", "Time constant.", 0.0, 0.02, 2e-3),),
    contributions=lambda values: (Change(Constant.TORQUE_LAG, values["lag_s"]),),
    term=Term.LAG,
    least_rate_hz=ACCELERATION_HZ,
    trace=Trace(_healthy_lag),
    empirical_forms=_empirical_forms,
)
