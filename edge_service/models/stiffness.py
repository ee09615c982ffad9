"""Axial stiffness between motor and table: springs in series along the stroke (seed, 5.3.1)."""

import math

from .compiled import compiled

STEEL_MODULUS_PA = 2.06e11
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
    """Cross section of the screw taken as a cylinder, m^2."""
    return math.pi * diameter_m**2 / 4.0


@compiled
def screw_compliance(
    position_m: float, axial_rigidity_n: float, length_m: float, far_end_fixed: float
) -> float:
    """Axial compliance of the screw at the nut, m/N (5.3.9, 5.3.10).

    Fixed-free: a / (A E). Fixed-fixed: a (L - a) / (A E L). `position_m` is the distance a of the
    nut from the fixed bearing, `axial_rigidity_n` is A E, `far_end_fixed` is 0.0 or 1.0.
    """
    reach = min(max(position_m, 0.0), length_m)
    return reach * (1.0 - far_end_fixed * reach / length_m) / axial_rigidity_n


@compiled
def nut_stiffness(catalogue_n_per_m: float, preload_percent: float) -> float:
    """Axial stiffness of a nut under preload, N/m: 0.8 K (F_a / (0.1 C_a))^(1/3) (5.3.11)."""
    load_percent = max(preload_percent, LEAST_NUT_LOAD_PERCENT)
    stiffening = math.pow(load_percent / CATALOGUE_PRELOAD_PERCENT, 1.0 / 3.0)
    return NUT_MODEL_FACTOR * catalogue_n_per_m * stiffening


def catalogue_nut_stiffness(stiffness_n_per_m: float, preload_percent: float) -> float:
    """Catalogue stiffness K of a nut whose stiffness at a preload is known: (5.3.11) solved."""
    return stiffness_n_per_m / nut_stiffness(1.0, preload_percent)


def axial_stiffness_of_torsion(torsional_nm_per_rad: float, ratio_m_per_rad: float) -> float:
    """Axial stiffness that a torsional spring shows through the screw, N/m: k_t / R_t^2."""
    return torsional_nm_per_rad / ratio_m_per_rad**2
