"""A torque that comes late."""

from ..contribution import Change, Contribution, Quantity
from ..effect import Effect, Parameter, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (Change(Quantity.TORQUE_LAG, values["lag_s"]),)


EFFECT = Effect(
    name="delay",
    description="The torque follows its command late: a slow current loop, or a filter too strong.",
    source="first-order lag: command = torque + T d torque / dt",
    parameters=(Parameter("lag_s", "s", "Time constant.", 0.0, 0.02, 0.0, 2e-3),),
    contributions=_contributions,
)
