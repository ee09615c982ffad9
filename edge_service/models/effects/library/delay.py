"""A torque that comes late."""

from ..contribution import Change, Constant
from ..effect import ACCELERATION_HZ, MATERIAL_TOLERANCES, Effect, Kind, Term, Trace, amount
from ..signature import usual_lag_s

_STAMPED_S = 1e-4
"""Assumption: no torque is stamped less exactly."""


def _healthy_lag(period_s: float, _coulomb_nm: float) -> tuple[float, float]:
    """Mean and standard deviation of the lag, s: from none to twice the usual one."""
    usual_s = usual_lag_s(period_s)
    return usual_s, (usual_s + _STAMPED_S) / MATERIAL_TOLERANCES


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
)
