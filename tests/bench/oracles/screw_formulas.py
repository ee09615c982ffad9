"""Inertia and drag torque of a ball screw from its data (thesis, section 4.3)."""

import math
from typing import TypeVar

from edge_service.messages.samples import Floats
from edge_service.models.bounds import require_not_negative, require_positive
from edge_service.models.screw.ball_screw import transmission_ratio

Number = TypeVar("Number", float, Floats)
"""One number, or an array of any shape; NaN in is NaN out."""


def screw_inertia(density_kg_m3: float, length_m: float, diameter_m: float) -> float:
    """Inertia of the screw taken as a cylinder, kg m^2: J_bs = rho l pi d^4 / 32 (4.3.1).

    Raises:
        ValueError: one of the three is not greater than 0.

    >>> round(screw_inertia(8050.0, 1.0, 0.02), 6)  # Table 4.1: 1.26e-4
    0.000126
    """
    require_positive(density_kg_m3=density_kg_m3, length_m=length_m, diameter_m=diameter_m)
    return density_kg_m3 * length_m * math.pi * diameter_m**4 / 32.0


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
