"""A spring that the table works against along its travel; it is no part of the library."""

from edge_service.models.effects.contribution import Contribution, Curve, Over, Side, SmoothTorque
from edge_service.models.effects.effect import Effect, Kind, Parameter, Role, Values


def _contributions(values: Values) -> tuple[Contribution, ...]:
    curve = _spring(values["slope_nm_per_m"], values["centre_m"])
    return (SmoothTorque(Over.POSITION, curve, Side.TABLE),)


def _spring(slope_nm_per_m: float, centre_m: float) -> Curve:
    return lambda position_m: slope_nm_per_m * (position_m - centre_m)


EFFECT = Effect(
    name="spring_load",
    description="A bellows, a hose or a balancer pulls the table back like a spring.",
    source="Hooke (1678), De Potentia Restitutiva: torque R k (x - x_0), held at rest too",
    kind=Kind.LOAD,
    parameters=(
        Parameter(
            "slope_nm_per_m",
            "N m/m",
            "Torque at the motor per metre of travel.",
            -50.0,
            50.0,
            0.0,
            0.5,
        ),
        Parameter("centre_m", "m", "Where it is at rest.", -10.0, 50.0, 0.4, 0.4, Role.SHAPE),
    ),
    contributions=_contributions,
    most_entries=1,
)
