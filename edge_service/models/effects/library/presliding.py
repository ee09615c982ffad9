"""Friction that gives way before it slides."""

from ..contribution import Change, Constant
from ..effect import ACCELERATION_HZ, Effect, Kind, Parameter, Role, Trace

EFFECT = Effect(
    name="presliding",
    description="At reversals friction builds up over some micrometres like a spring.",
    source="Dupont et al. (2002), elasto-plastic bristle: torque F_c (bristle - s(v))",
    kind=Kind.FRICTION,
    parameters=(
        Parameter("reach_m", "m", "Travel before it slides.", 0.0, 1e-3, 0.0, 2e-5, Role.SHAPE),
    ),
    contributions=lambda values: (Change(Constant.PRESLIDING_REACH, values["reach_m"]),),
    least_rate_hz=ACCELERATION_HZ,
    imitates=frozenset({"backlash", "compliance", "quadratic_friction", "stribeck"}),
    most_shapes=1,
    most_entries=1,
    trace=Trace(lambda _period_s, _coulomb_nm: (0.5, 0.5), {"reach_m": 1e-6}),  # its share
)
