"""A constant load, and Coulomb friction that differs by direction."""

import numpy as np

from ..contribution import DryFriction, Over, Side, SmoothTorque, constant
from ..effect import Effect, Kind, amount

EFFECT = Effect(
    name="load_offset",
    description="One direction needs more torque: the axis is tilted, or rubs harder one way.",
    source="tilt and gravity m g sin(angle) R, also at rest; (5.3.14) f_offset; EMPS' asymmetry",
    kind=Kind.LOAD,
    parameters=(
        amount(
            "constant_nm", "N m", "Torque against positive motion, also at rest.", -50.0, 50.0, 0.1
        ),
        amount(
            "asymmetry_nm", "N m", "Coulomb level up forwards, down backwards.", -5.0, 5.0, 0.05
        ),
    ),
    contributions=lambda values: (
        SmoothTorque(Over.TIME, constant(values["constant_nm"]), Side.TABLE),
        DryFriction(Over.SPEED, lambda v: values["asymmetry_nm"] * np.sign(v), Side.AS_DRAG),
    ),
)
