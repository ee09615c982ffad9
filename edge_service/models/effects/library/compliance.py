"""More give between motor and table than the model knows."""

from ..contribution import Change, Contribution, LateGrip, Quantity
from ..effect import Effect, Parameter, Role, Values, friction_share, viscous_share


def _contributions(values: Values) -> tuple[Contribution, ...]:
    level, slope = values["level_m_per_n"], values["slope_per_n"]
    rubbed, stirred = values["friction_share"] - 1.0, values["viscous_share"]
    changes = (
        (Quantity.COMPLIANCE, level),
        (Quantity.COMPLIANCE_SLOPE, slope),
        (Quantity.RUBBED_COMPLIANCE, rubbed * level),
        (Quantity.RUBBED_COMPLIANCE_SLOPE, rubbed * slope),
        (Quantity.STIRRED_COMPLIANCE, stirred * level),
        (Quantity.STIRRED_COMPLIANCE_SLOPE, stirred * slope),
    )
    found = tuple(Change(quantity, value) for quantity, value in changes if value != 0.0)
    if values["reach_m"] > 0.0:
        late = LateGrip(level, slope, values["friction_share"], values["reach_m"])
        return (*found, late)
    return found


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
        friction_share(),
        viscous_share(),
        Parameter(
            "reach_m",
            "m",
            "Travel of the motor over which the table's dry friction builds up on a recording; "
            "0: at once. A simulated axis has that of its spring.",
            0.0,
            1e-4,
            0.0,
            0.0,
            Role.SHAPE,
        ),
    ),
    contributions=_contributions,
)
