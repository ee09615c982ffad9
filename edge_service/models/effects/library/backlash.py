"""Lost motion between screw and table.

Only friction holds a table within its play. Where the machine file states no `guide_force_n`, the
simulated axis has none there, and its position loop hunts across the clearance at rest, as a real
one would; two newtons end it.
"""

from ..contribution import Contribution, Play
from ..effect import Effect, Parameter, Role, Values, friction_share, viscous_share


def _contributions(values: Values) -> tuple[Contribution, ...]:
    return (Play(values["width_m"], values["friction_share"], values["viscous_share"]),)


EFFECT = Effect(
    name="backlash",
    description="At a reversal the motor turns before the table moves: there is clearance.",
    source="play operator; flanks touch after positive motion, so x - R theta is 0 or the width",
    parameters=(
        Parameter("width_m", "m", "Clearance.", 0.0, 2e-3, 0.0, 1e-5, Role.SHAPE),
        friction_share(),
        viscous_share(),
    ),
    contributions=_contributions,
)
