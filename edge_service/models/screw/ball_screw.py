"""Ball screw geometry, and the inertia of what it moves (thesis, section 4.3)."""

import math
from dataclasses import dataclass


def transmission_ratio(lead_m: float) -> float:
    """Table travel per radian of the screw, m/rad: R_t = h_p / 2 pi (4.3.5).

    Table 4.1 prints 1.59e-3 m/rad, which is half of what its lead of 20 mm gives.

    >>> round(transmission_ratio(0.02), 6)
    0.003183
    """
    return lead_m / (2.0 * math.pi)


EFFICIENCY = 0.9
"""Of the screw, eta of (4.3.6): Table 4.1."""


def lead_angle(lead_m: float, ball_circle_m: float) -> float:
    """Lead angle alpha of (4.3.6), rad: tan alpha = h_p / (pi d), d the ball circle's diameter.

    >>> round(math.degrees(lead_angle(0.02, 0.0206)), 2)  # Table A.1: 17.17 degrees
    17.17
    """
    return math.atan(lead_m / (math.pi * ball_circle_m))


def preload_drag(
    preload_n: float, lead_m: float, lead_angle_rad: float, efficiency: float = EFFICIENCY
) -> float:
    """Drag torque of a preload, N m: 0.05 / sqrt(tan alpha) F_p h_p / (2 pi eta) (4.3.6).

    Table A.1 prints 1.18 to 1.77 "Nm" for 510 N, which is kgf cm: 0.116 to 0.174 N m.

    >>> round(preload_drag(510.0, 0.02, math.radians(17.17)), 3)
    0.162
    """
    share = 0.05 / math.sqrt(math.tan(lead_angle_rad))
    return share * preload_n * transmission_ratio(lead_m) / efficiency


def screw_inertia(diameter_m: float, length_m: float) -> float:
    """Inertia of a steel screw as a cylinder, kg m^2: J_bs = rho l pi d^4 / 32 (4.3.1).

    >>> round(screw_inertia(0.02, 1.0), 6)  # Table 4.1: 1.26e-4
    0.000126
    """
    return 8050.0 * length_m * math.pi * diameter_m**4 / 32.0


@dataclass(frozen=True, slots=True)
class BallPassOrders:
    """Ball pass orders: events per revolution of the screw in a nut that does not turn."""

    on_nut: float  # balls pass a point of the nut's track, and enter its circuit
    on_screw: float  # balls pass a point of the screw's track
    spin: float  # a ball turns about itself; a spot on it meets each track once per turn


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
    the lead angle lambda; D is the circle of the balls' centres. Unless z is given, balls touch:
    z = pi D / (d cos lambda) per turn of one track. Balls slip by a per cent or two.

    >>> orders = ball_pass_orders(3.175e-3, 0.0206, 0.02, math.radians(45.0))
    >>> round(orders.on_nut, 2), round(orders.on_screw, 2), round(orders.spin, 2)
    (9.56, 11.78, 3.21)
    """
    tangent = math.tan(lead_angle(lead_m, ball_circle_m))
    climb = 1.0 / math.hypot(1.0, tangent)
    balls = balls_per_turn or math.pi * ball_circle_m / (ball_diameter_m * climb)
    share = ball_diameter_m * math.cos(contact_angle_rad) * climb / ball_circle_m
    return BallPassOrders(
        on_nut=0.5 * balls * (1.0 - share),
        on_screw=0.5 * balls * (1.0 + share),
        spin=0.5 * ball_circle_m / ball_diameter_m * (1.0 - share**2),
    )


def table_inertia(mass_kg: float, lead_m: float) -> float:
    """Inertia of table and workpiece at the screw, kg m^2: J_t = (m_t + m_wp) (h_p / 2 pi)^2.

    (4.3.2) as printed squares the lead only; the value in Table 4.1 has the square over 2 pi too.

    >>> round(table_inertia(20.0, 0.02), 6)  # Table 4.1: 2e-4
    0.000203
    """
    return mass_kg * transmission_ratio(lead_m) ** 2
