"""Another mass on the table than the model knows."""

from ..contribution import Change, Constant
from ..effect import Effect, Kind, Term, amount

EFFECT = Effect(
    name="inertia_error",
    description="The axis carries more or less mass than the model knows, such as a workpiece.",
    source="thesis (4.3.2): dJ = dm (h_p / 2 pi)^2; torque dJ a, wind-up -R dJ a / K",
    kind=Kind.LOAD,
    parameters=(
        amount(
            "change_kg_m2", "kg m^2", "Inertia added to the table, at the motor.", -0.05, 0.2, 2e-4
        ),
    ),
    contributions=lambda values: (Change(Constant.TABLE_INERTIA, values["change_kg_m2"]),),
    term=Term.INERTIA,
)
