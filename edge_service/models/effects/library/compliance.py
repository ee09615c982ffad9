"""More give between motor and table than the model knows."""

from ..contribution import Change, Contribution, Quantity
from ..effect import Effect, Parameter, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (
        Change(Quantity.COMPLIANCE, values["level_m_per_n"]),
        Change(Quantity.COMPLIANCE_SLOPE, values["slope_per_n"]),
    )


EFFECT = Effect(
    name="compliance",
    description="The drive train gives more under load: a loose coupling, bearing or nut.",
    source="seed (5.3.1), (5.3.9): x - R theta = -(c_0 + c_1 x) T_load / R",
    parameters=(
        Parameter(
            "level_m_per_n",
            "m/N",
            "Compliance more, at the fixed bearing.",
            -1e-6,
            1e-5,
            0.0,
            2e-8,
        ),
        Parameter(
            "slope_per_n", "1/N", "Compliance more, per metre from there.", -1e-5, 1e-5, 0.0, 3e-8
        ),
    ),
    contributions=_contributions,
)
