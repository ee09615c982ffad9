"""Axial stiffness of screw and coupling between motor and table (thesis, 5.3.9, 5.3.10)."""

import math

from ..compiled import compiled

STEEL_MODULUS_PA = 2.06e11
STEEL_SHEAR_MODULUS_PA = 7.9e10


def screw_area(diameter_m: float) -> float:
    """Cross section A of (5.3.9) of the screw taken as a cylinder, m^2: pi d^2 / 4.

    The nominal diameter is generous: a core of 17.5 mm in a 20 mm screw has 23 % less.

    >>> round(screw_area(0.02) * 1e6, 1)  # mm^2
    314.2
    """
    return math.pi * diameter_m**2 / 4.0


def screw_torsional_rigidity(diameter_m: float) -> float:
    """Twisting moment per twist and length of a steel screw, N m^2: G I_p = G pi d^4 / 32.

    Not in the thesis; I_p is the cylinder's, as in (4.3.1). Like A E it is on the generous side.

    >>> round(screw_torsional_rigidity(0.02))
    1241
    """
    return STEEL_SHEAR_MODULUS_PA * math.pi * diameter_m**4 / 32.0


@compiled
def screw_compliance(
    position_m: float,
    axial_rigidity_n: float,
    length_m: float,
    far_end_fixed: float,
    bearing_m_per_n: float = 0.0,
) -> float:
    """Axial compliance of the screw in its bearings at the nut, m/N (5.3.2, 5.3.9, 5.3.10).

    Each held end is an arm: the bearing with its support, c, and a rod of A E. Fixed-free has one,
    c + a / (A E), with a the nut's place from the fixed bearing; fixed-fixed (`far_end_fixed` 1.0)
    has two side by side, of the lengths a and L - a. The thesis lets the fixed-free stiffness fall
    "linearly" along the screw; it is the compliance that grows linearly.

    >>> round(1.0 / screw_compliance(0.5, 6.4e7, 1.0, 0.0) / 1e8, 3)
    1.28
    >>> round(1.0 / screw_compliance(0.5, 6.4e7, 1.0, 1.0) / 1e8, 3)
    2.56
    """
    reach = min(max(position_m, 0.0), length_m)
    near = bearing_m_per_n + reach / axial_rigidity_n
    if far_end_fixed == 0.0:
        return near
    far = bearing_m_per_n + (length_m - reach) / axial_rigidity_n
    return near * far / (near + far)


def axial_stiffness_of_torsion(torsional_nm_per_rad: float, ratio_m_per_rad: float) -> float:
    """Axial stiffness that a torsional spring shows through the screw, N/m: k_t / R_t^2.

    An axial force F is a torque R_t F, it twists the spring by R_t F / k_t, and the table moves by
    R_t times that. The test bench's coupling (Table A.5: 67.2 N m/degree):

    >>> round(axial_stiffness_of_torsion(67.2 * 180.0 / math.pi, 0.02 / (2.0 * math.pi)) / 1e8, 2)
    3.8
    """
    return torsional_nm_per_rad / ratio_m_per_rad**2
