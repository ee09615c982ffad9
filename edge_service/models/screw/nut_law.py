"""Law of the ball nut: stiffness and deflection under preload and load (thesis, 5.3.11).

Opposed Hertz contacts, F ~ d^(3/2): for loads that are small beside the preload the stiffness grows
with the cube root of the preload, and catalogues state it at one preload.
"""

import math

from ..compiled import compiled, inlined

NUT_MODEL_FACTOR = 0.8
"""Housing and screw around the balls make the nut softer than its catalogue value (5.3.11)."""
CATALOGUE_PRELOAD_PERCENT = 10.0
"""Catalogues state a nut's stiffness at a preload of a tenth of the load rating (5.3.11)."""
LEAST_NUT_LOAD_PERCENT = 0.5
"""Assumption: load that the balls carry without any preload, in percent of the load rating.

(5.3.11) tends to zero with the preload, but a nut without preload is stiffened by the load that
it moves (Fig. 5.6); 0.5 % is half of what 20 kg need at 4 m/s2 on the thesis' screw.
"""
_LEAST_PERCENT = 0.02
_LOOSE_PERCENT = 0.15


@compiled
def nut_stiffness(catalogue_n_per_m: float, preload_percent: float) -> float:
    """Axial stiffness of a nut under preload, N/m: 0.8 K (F_a / (0.1 C_a))^(1/3) (5.3.11).

    K is the catalogue's, F_a the preload and C_a the dynamic load rating; `preload_percent` is
    100 F_a / C_a. Below `LEAST_NUT_LOAD_PERCENT` the stiffness stays.

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


def preload_ratio(change_m_per_n: float, nut_m_per_n: float) -> float:
    """Preload over the fresh one, from 0 to infinity: F / F_fresh = (1 + dC / c_fresh)^-3.

    (5.3.11) solved for the preload, in compliances: c = 1 / K_n and dC its change since fresh.

    >>> preload_ratio(1e-8, 1e-8)  # twice the compliance
    0.125
    """
    if nut_m_per_n <= 0.0:
        return math.inf if change_m_per_n < 0.0 else 0.0
    growth = 1.0 + change_m_per_n / nut_m_per_n
    return growth**-3 if growth > 0.0 else math.inf


def loaded_nut_stiffness(
    load_n: float, preload_percent: float, catalogue_n_per_m: float, rating_n: float
) -> float:
    """Slope of the force over the deflection of a nut under load, N/m (Figure 5.6).

    Without load that of (5.3.11), which it leaves little while both nuts carry; where one of them
    is free, beyond 2.8 times the preload, that of the other alone, whatever the preload was.

    >>> round(loaded_nut_stiffness(0.0, 10.0, 1.6e8, 7450.0) / 1e8, 3)
    1.28
    """
    if load_n == preload_percent == 0.0:
        return 0.0
    percent = CATALOGUE_PRELOAD_PERCENT
    preload_n = percent / 100.0 * rating_n
    own_m = 3.0 * preload_n / nut_stiffness(catalogue_n_per_m, percent)
    return 1.0 / (own_m * nut_deflection(load_n, preload_percent, percent, preload_n, 0.0)[1])


@inlined
def nut_deflection(
    load_n: float,
    percent: float,
    fresh_percent: float,
    fresh_preload_n: float,
    clearance_share: float,
) -> tuple[float, float, float]:
    """Deflection of a preloaded pair of nuts, over the fresh pair's own preload deflection d0.

    Two opposed Hertz contacts, F = c ((q + y)^1.5 - (q - y)^1.5), with y = d / d0 and
    q = (p / p0)^(2/3); for small loads the stiffness is 3 F0 q^0.5 / d0, the cube root law of
    (5.3.11). Without preload the pair has a clearance, q < 0.

    `percent` is p, of the load rating, `fresh_percent` p0, `fresh_preload_n` its force F0, and
    `clearance_share` the clearance without preload over d0. Returns y, dy/dF 1/N and dy/dp 1/%.

    >>> round(nut_deflection(1.0, 7.0, 7.0, 700.0, 0.0)[0] * 3.0 * 700.0, 6)
    1.0
    """
    lost = clearance_share * math.exp(-max(percent, 0.0) / _LOOSE_PERCENT)
    share = max(percent, _LEAST_PERCENT) / fresh_percent
    q = math.pow(share, 2.0 / 3.0) - lost
    q_slope = 2.0 / 3.0 * math.pow(share, -1.0 / 3.0) / fresh_percent + lost / _LOOSE_PERCENT
    force = abs(load_n) / fresh_preload_n
    y = max(force / (3.0 * math.sqrt(max(q, 0.01))), 0.0)
    if q <= 0.0 or y > q:
        y = math.pow(force, 2.0 / 3.0) - q
    up, down = 0.0, 0.0
    for _ in range(4):
        up, down = math.sqrt(max(q + y, 1e-12)), math.sqrt(max(q - y, 0.0))
        y -= (up**3 - down**3 - force) / (1.5 * (up + down))
        y = max(y, -q, 0.0)
    up, down = math.sqrt(max(q + y, 1e-6)), math.sqrt(max(q - y, 0.0))
    sign = 1.0 if load_n >= 0.0 else -1.0
    by_force = 1.0 / (1.5 * (up + down) * fresh_preload_n)
    return sign * y, by_force, -sign * (up - down) / (up + down) * q_slope
