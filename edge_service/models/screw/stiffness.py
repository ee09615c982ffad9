"""Axial stiffness of the parts between motor and table (seed, 5.3.9-5.3.11, Table A.5)."""

import math

from ..bounds import require_positive
from ..compiled import compiled

STEEL_MODULUS_PA = 2.06e11
STEEL_SHEAR_MODULUS_PA = 7.9e10
NUT_MODEL_FACTOR = 0.8
"""Housing and screw around the balls make the nut softer than its catalogue value (5.3.11)."""
CATALOGUE_PRELOAD_PERCENT = 10.0
"""Catalogues state a nut's stiffness at a preload of a tenth of the load rating (5.3.11)."""
LEAST_NUT_LOAD_PERCENT = 0.5
"""Assumption: load that the balls carry without any preload, in percent of the load rating.

(5.3.11) tends to zero with the preload, but a nut without preload is stiffened by the load that
it moves (Fig. 5.6); 0.5 % is half of what 20 kg need at 4 m/s2 on the seed's screw.
"""


def screw_area(diameter_m: float) -> float:
    """Cross section A of (5.3.9) of the screw taken as a cylinder, m^2: pi d^2 / 4.

    The nominal diameter is generous: the core between the grooves carries less. A core of 17.5 mm
    in a 20 mm screw has 23 % less, which a tolerance of the rigidity should cover.

    >>> round(screw_area(0.02) * 1e6, 1)  # mm^2
    314.2
    """
    return math.pi * diameter_m**2 / 4.0


def screw_torsional_rigidity(diameter_m: float) -> float:
    """Twisting moment per twist and length of a steel screw, N m^2: G I_p = G pi d^4 / 32.

    Not in the seed; I_p is the cylinder's, as in (4.3.1). Like A E it is on the generous side.

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

    Each held end is an arm: the bearing with its support and a rod of A E. Fixed-free has one,
    c + a / (A E); fixed-fixed has two side by side, of the lengths a and L - a. Without the
    compliance c of a bearing they are (5.3.9), a / (A E), and (5.3.10), a (L - a) / (A E L); the L
    of (5.3.9) is this a, and b of (5.3.10) is L - a. The seed lets the fixed-free stiffness fall
    "linearly" along the screw; it is the compliance that grows linearly.

    Args:
        position_m: a, of the nut from the fixed bearing.
        axial_rigidity_n: A E.
        far_end_fixed: 0.0 or 1.0.
        bearing_m_per_n: c, of one fixed bearing with its support.

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


@compiled
def nut_stiffness(catalogue_n_per_m: float, preload_percent: float) -> float:
    """Axial stiffness of a nut under preload, N/m: 0.8 K (F_a / (0.1 C_a))^(1/3) (5.3.11).

    K_n is the true stiffness of the nut, K the nominal one of its catalogue, F_a the force of the
    preload and C_a the dynamic load rating; the seed's text calls three of the four F_a. Here
    `preload_percent` is 100 F_a / C_a. Below `LEAST_NUT_LOAD_PERCENT` the stiffness stays.

    >>> round(nut_stiffness(1.6e8, 10.0) / 1e8, 3)
    1.28
    """
    load_percent = max(preload_percent, LEAST_NUT_LOAD_PERCENT)
    stiffening = math.pow(load_percent / CATALOGUE_PRELOAD_PERCENT, 1.0 / 3.0)
    return NUT_MODEL_FACTOR * catalogue_n_per_m * stiffening


def catalogue_nut_stiffness(stiffness_n_per_m: float, preload_percent: float) -> float:
    """Catalogue stiffness K of a nut whose stiffness at a preload is known, N/m: (5.3.11) solved.

    >>> round(catalogue_nut_stiffness(1.28e8, 10.0) / 1e8, 3)
    1.6
    """
    return stiffness_n_per_m / nut_stiffness(1.0, preload_percent)


def preload_from_nut_stiffness(stiffness_n_per_m: float, catalogue_n_per_m: float) -> float:
    """Preload that gives a nut its stiffness, percent of the load rating: (5.3.11) solved for F_a.

    10 (K_n / (0.8 K))^3: a relative deviation of either stiffness counts three times. An answer
    at or below `LEAST_NUT_LOAD_PERCENT` means "that or less": there the stiffness stays.

    Raises:
        ValueError: a stiffness is not greater than 0.

    >>> round(preload_from_nut_stiffness(1.28e8, 1.6e8), 6)
    10.0
    """
    require_positive(stiffness_n_per_m=stiffness_n_per_m, catalogue_n_per_m=catalogue_n_per_m)
    share = stiffness_n_per_m / (NUT_MODEL_FACTOR * catalogue_n_per_m)
    return max(CATALOGUE_PRELOAD_PERCENT * share**3, LEAST_NUT_LOAD_PERCENT)


def axial_stiffness_of_torsion(torsional_nm_per_rad: float, ratio_m_per_rad: float) -> float:
    """Axial stiffness that a torsional spring shows through the screw, N/m: k_t / R_t^2.

    An axial force F is a torque R_t F, it twists the spring by R_t F / k_t, and the table moves by
    R_t times that. The bench's coupling (Table A.5: 67.2 N m/degree):

    >>> round(axial_stiffness_of_torsion(67.2 * 180.0 / math.pi, 0.02 / (2.0 * math.pi)) / 1e8, 2)
    3.8
    """
    require_positive(ratio_m_per_rad=ratio_m_per_rad)
    return torsional_nm_per_rad / ratio_m_per_rad**2
