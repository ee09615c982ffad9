"""Ball screw geometry, inertia, and drag torque against preload (seed, section 4.3)."""

import math


def transmission_ratio(lead_m: float) -> float:
    """Table travel per radian of the screw, m/rad: R_t = h_p / 2 pi (4.3.5)."""
    return lead_m / (2.0 * math.pi)


def screw_inertia(density_kg_m3: float, length_m: float, diameter_m: float) -> float:
    """Inertia of the screw taken as a cylinder, kg m^2: rho l pi d^4 / 32 (4.3.1)."""
    return density_kg_m3 * length_m * math.pi * diameter_m**4 / 32.0


def table_inertia(mass_kg: float, lead_m: float) -> float:
    """Inertia of a carried mass at the screw, kg m^2: m (h_p / 2 pi)^2.

    (4.3.2) as printed lacks the square over 2 pi; the value in Table 4.1 has it.
    """
    return mass_kg * transmission_ratio(lead_m) ** 2


def drag_torque(preload_n: float, lead_m: float, lead_angle_rad: float, efficiency: float) -> float:
    """Drag torque of a preloaded ball screw, N m (4.3.6).

    d_p = 0.05 / sqrt(tan alpha) * F_p h_p / (2 pi eta)
    """
    return preload_n * _drag_arm(lead_m, lead_angle_rad, efficiency)


def preload_from_drag(
    drag_nm: float, lead_m: float, lead_angle_rad: float, efficiency: float
) -> float:
    """Preload that causes a drag torque, N: (4.3.6) solved for F_p."""
    return drag_nm / _drag_arm(lead_m, lead_angle_rad, efficiency)


def _drag_arm(lead_m: float, lead_angle_rad: float, efficiency: float) -> float:
    return 0.05 / math.sqrt(math.tan(lead_angle_rad)) * transmission_ratio(lead_m) / efficiency
