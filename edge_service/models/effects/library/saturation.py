"""A drive that gives less than its greatest torque."""

from ..contribution import Change, Constant
from ..effect import ACCELERATION_HZ, Effect, Kind, Parameter, Role

EFFECT = Effect(
    name="saturation",
    description="The drive cuts the torque off below its command: a current limit is too low.",
    source="command beyond the limit, (|tau| - L)+, does nothing",
    kind=Kind.DRIVE,
    parameters=(
        Parameter(
            "limit_nm", "N m", "Greatest torque of the drive.", 1e-3, 1e4, 1e4, 2.0, Role.SHAPE
        ),
    ),
    contributions=lambda values: (Change(Constant.TORQUE_LIMIT, values["limit_nm"]),),
    follows_own_torque=True,
    least_rate_hz=ACCELERATION_HZ,
)
