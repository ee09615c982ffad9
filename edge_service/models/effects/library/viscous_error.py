"""Another viscous friction than the model knows."""

from ..contribution import Change, Constant
from ..effect import Effect, Kind, Term, amount

EFFECT = Effect(
    name="viscous_error",
    description="Friction grows faster with speed than the model knows, as with stiffer grease.",
    source="thesis (5.3.15): torque dD v",
    kind=Kind.FRICTION,
    parameters=(
        amount("change_nm_s_per_rad", "N m s/rad", "Increase, at the motor.", -0.1, 0.2, 4e-3),
    ),
    contributions=lambda values: (Change(Constant.VISCOUS, values["change_nm_s_per_rad"]),),
    term=Term.VISCOUS,
)
