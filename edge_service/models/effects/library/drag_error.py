"""Another Coulomb level than the model knows: what preload loss looks like."""

from ..contribution import DryFriction, Over, Side, constant
from ..effect import Effect, Kind, Term, amount

EFFECT = Effect(
    name="drag_error",
    description="The constant friction changed: warmth, grease, seals; a lost preload lowers it.",
    source="thesis (4.3.6), (5.3.14): torque s(v) dF_c, wind-up where the level acts on the table",
    kind=Kind.FRICTION,
    parameters=(
        amount("change_nm", "N m", "Increase of the Coulomb level at the motor.", -5.0, 5.0, 0.06),
    ),
    contributions=lambda values: (
        DryFriction(Over.TIME, constant(values["change_nm"]), Side.AS_DRAG),
    ),
    term=Term.COULOMB,
)
