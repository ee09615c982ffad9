"""Friction that gives way before it slides."""

from ..contribution import Change, Contribution, Quantity
from ..effect import Effect, Parameter, Role, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (Change(Quantity.PRESLIDING_REACH, values["reach_m"]),)


EFFECT = Effect(
    name="presliding",
    description="At reversals friction builds up over some micrometres like a spring.",
    source="Dupont et al. (2002), elasto-plastic bristle: torque F_c (bristle - s(v))",
    parameters=(
        Parameter(
            "reach_m",
            "m",
            "Friction level over presliding stiffness, as table travel.",
            0.0,
            1e-3,
            0.0,
            2e-5,
            Role.SHAPE,
        ),
    ),
    contributions=_contributions,
)
