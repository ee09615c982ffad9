"""Ball screw geometry, inertia, and drag torque against preload (thesis, section 4.3)."""

import math
from dataclasses import dataclass
from typing import TypeVar

from ...messages.samples import Floats
from ..bounds import require_not_negative, require_positive

Number = TypeVar("Number", float, Floats)
"""One number, or an array of any shape; NaN in is NaN out."""


def transmission_ratio(lead_m: float) -> float:
    """Table travel per radian of the screw, m/rad: R_t = h_p / 2 pi (4.3.5).

    Table 4.1 prints 1.59e-3 m/rad, which is half of what its lead of 20 mm gives.

    Raises:
        ValueError: the lead is not greater than 0.

    >>> round(transmission_ratio(0.02), 6)
    0.003183
    """
    require_positive(lead_m=lead_m)
    return lead_m / (2.0 * math.pi)


def lead_angle(lead_m: float, ball_circle_m: float) -> float:
    """Lead angle alpha of (4.3.6), rad: tan alpha = h_p / (pi d), d the ball circle's diameter.

    Raises:
        ValueError: the lead or the diameter is not greater than 0.

    >>> round(math.degrees(lead_angle(0.02, 0.0206)), 2)  # Table A.1: 17.17 degrees
    17.17
    """
    require_positive(lead_m=lead_m, ball_circle_m=ball_circle_m)
    return math.atan(lead_m / (math.pi * ball_circle_m))


@dataclass(frozen=True, slots=True)
class BallPassOrders:
    """Ball pass orders: events per revolution of the screw in a nut that does not turn.

    Attributes:
        on_nut: balls pass a point of the nut's track, and enter its circuit.
        on_screw: balls pass a point of the screw's track.
        spin: a ball turns about itself; a spot on it meets each track once per turn.
    """

    on_nut: float
    on_screw: float
    spin: float


def ball_pass_orders(
    ball_diameter_m: float,
    ball_circle_m: float,
    lead_m: float,
    contact_angle_rad: float,
    balls_per_turn: float | None = None,
) -> BallPassOrders:
    """Orders of the balls: those of an angular-contact bearing along the helix.

    Not in the thesis. z / 2 (1 - g), z / 2 (1 + g) and D / (2 d) (1 - g^2) with the share
    g = d cos(beta) cos(lambda) / D, a ball bearing's formulas (Harris and Kotzalas, Rolling Bearing
    Analysis, 2006) with the contact angle beta in the section normal to the track, which climbs by
    the lead angle lambda. Balls without spacers touch: z = pi D / (d cos lambda) per turn of one
    track. Circuits and starts change the strength of an order, not its place. Balls slip by a per
    cent or two.

    Args:
        ball_circle_m: D, the diameter of the circle of the balls' centres.
        balls_per_turn: z; unless given that of balls without spacers.

    Raises:
        ValueError: a length is not greater than 0, the balls do not fit, or the angle cannot be.

    >>> orders = ball_pass_orders(3.175e-3, 0.0206, 0.02, math.radians(45.0))
    >>> round(orders.on_nut, 2), round(orders.on_screw, 2), round(orders.spin, 2)
    (9.56, 11.78, 3.21)
    """
    tangent = math.tan(lead_angle(lead_m, ball_circle_m))
    require_positive(ball_diameter_m=ball_diameter_m)
    if not ball_diameter_m < ball_circle_m:
        raise ValueError(f"ball_diameter_m: {ball_diameter_m:g} does not fit {ball_circle_m:g} m")
    if not 0.0 <= contact_angle_rad < math.pi / 2.0:
        raise ValueError(f"contact_angle_rad must lie from 0 to pi / 2, got {contact_angle_rad:g}")
    climb = 1.0 / math.hypot(1.0, tangent)
    balls = balls_per_turn
    if balls is None:
        balls = math.pi * ball_circle_m / (ball_diameter_m * climb)
    require_positive(balls_per_turn=balls)
    share = ball_diameter_m * math.cos(contact_angle_rad) * climb / ball_circle_m
    return BallPassOrders(
        on_nut=0.5 * balls * (1.0 - share),
        on_screw=0.5 * balls * (1.0 + share),
        spin=0.5 * ball_circle_m / ball_diameter_m * (1.0 - share**2),
    )


def screw_inertia(density_kg_m3: float, length_m: float, diameter_m: float) -> float:
    """Inertia of the screw taken as a cylinder, kg m^2: J_bs = rho l pi d^4 / 32 (4.3.1).

    Raises:
        ValueError: one of the three is not greater than 0.

    >>> round(screw_inertia(8050.0, 1.0, 0.02), 6)  # Table 4.1: 1.26e-4
    0.000126
    """
    require_positive(density_kg_m3=density_kg_m3, length_m=length_m, diameter_m=diameter_m)
    return density_kg_m3 * length_m * math.pi * diameter_m**4 / 32.0


def table_inertia(mass_kg: float, lead_m: float) -> float:
    """Inertia of table and workpiece at the screw, kg m^2: J_t = (m_t + m_wp) (h_p / 2 pi)^2.

    (4.3.2) as printed, (m_t + m_wp) h_p^2 / 2 pi, squares the lead only; the value in Table 4.1
    has the square over 2 pi too.

    Raises:
        ValueError: the mass is negative or the lead not greater than 0.

    >>> round(table_inertia(20.0, 0.02), 6)  # Table 4.1: 2e-4
    0.000203
    """
    require_not_negative(mass_kg=mass_kg)
    return mass_kg * transmission_ratio(lead_m) ** 2


def lumped_inertia(
    motor_kg_m2: float, screw_kg_m2: float, table_kg_m2: float, coupling_kg_m2: float = 0.0
) -> float:
    """Inertia of the whole drive at the motor, kg m^2: J_e = J_bs + J_t + J_m (4.3.3).

    The print has no coupling; that of the test bench (Table A.5) is 7 % of the sum.

    Raises:
        ValueError: a part is negative.

    >>> round(lumped_inertia(3e-3, 1.26e-4, 2.03e-4), 6)  # Table 4.1: 3.3e-3
    0.003329
    """
    require_not_negative(
        motor_kg_m2=motor_kg_m2,
        screw_kg_m2=screw_kg_m2,
        table_kg_m2=table_kg_m2,
        coupling_kg_m2=coupling_kg_m2,
    )
    return motor_kg_m2 + screw_kg_m2 + table_kg_m2 + coupling_kg_m2


def drag_torque(
    preload_n: Number, lead_m: float, lead_angle_rad: float, efficiency: float
) -> Number:
    """Drag torque of a preloaded ball screw, N m, in the shape of `preload_n` (4.3.6).

    d_p = 0.05 / sqrt(tan alpha) * F_p h_p / (2 pi eta)

    Screw catalogues use the same formula without the efficiency: with eta = 1 and 510 N it gives
    0.146 N m, the middle of Table A.1's 0.116 to 0.174 N m (printed as 1.18 to 1.77 "Nm", which
    are kgf cm); with eta = 0.9 it gives 0.162 N m.

    Raises:
        ValueError: the lead, the lead angle or the efficiency cannot be.

    >>> round(drag_torque(510.0, 0.02, math.radians(17.17), 1.0), 3)
    0.146
    """
    return preload_n * _drag_arm(lead_m, lead_angle_rad, efficiency)


def preload_from_drag(
    drag_nm: Number, lead_m: float, lead_angle_rad: float, efficiency: float
) -> Number:
    """Preload that causes a drag torque, N, in the shape of `drag_nm`: (4.3.6) solved for F_p.

    A negative drag, as noise gives it, is a negative preload: cutting it off here would bias a
    mean. The relative tolerance of the result is `preload_tolerance`.

    Raises:
        ValueError: the lead, the lead angle or the efficiency cannot be.

    >>> round(preload_from_drag(0.146, 0.02, math.radians(17.17), 1.0))
    510
    """
    return drag_nm / _drag_arm(lead_m, lead_angle_rad, efficiency)


def preload_tolerance(
    drag_tolerance: float, efficiency_tolerance: float, factor_tolerance: float = 0.0
) -> float:
    """Relative standard deviation of the preload of (4.3.6) from those of its parts, (1).

    F_p is proportional to d_p and eta and to 1 / 0.05, so independent relative deviations add as
    squares. `factor_tolerance` is that of the empirical 0.05; Table A.1 grants the drag torque of
    one preload +-20 %.

    Raises:
        ValueError: a tolerance is negative.

    >>> round(preload_tolerance(0.03, 0.04), 3)
    0.05
    """
    require_not_negative(
        drag_tolerance=drag_tolerance,
        efficiency_tolerance=efficiency_tolerance,
        factor_tolerance=factor_tolerance,
    )
    return math.hypot(drag_tolerance, efficiency_tolerance, factor_tolerance)


def _drag_arm(lead_m: float, lead_angle_rad: float, efficiency: float) -> float:
    """Drag torque per newton of preload, m."""
    if not 0.0 < lead_angle_rad < math.pi / 2.0:
        raise ValueError(f"lead_angle_rad must lie between 0 and pi / 2, got {lead_angle_rad:g}")
    if not 0.0 < efficiency <= 1.0:
        raise ValueError(f"efficiency must be greater than 0 and at most 1, got {efficiency:g}")
    return 0.05 / math.sqrt(math.tan(lead_angle_rad)) * transmission_ratio(lead_m) / efficiency
