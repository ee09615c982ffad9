"""Another viscous friction than the model knows."""

from ..contribution import Change, Constant, Contribution
from ..effect import Effect, Kind, Parameter, Term, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (Change(Constant.VISCOUS, values["change_nm_s_per_rad"]),)


EFFECT = Effect(
    name="viscous_error",
    description="Friction grows faster with speed than the model knows, as with stiffer grease.",
    source="thesis (5.3.15): torque dD v",
    kind=Kind.FRICTION,
    parameters=(
        Parameter(
            "change_nm_s_per_rad",
            "N m s/rad",
            "Increase of the viscous coefficient at the motor.",
            -0.1,
            0.2,
            0.0,
            4e-3,
        ),
    ),
    contributions=_contributions,
    term=Term.VISCOUS,
)
