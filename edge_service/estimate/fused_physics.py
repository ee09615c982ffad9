"""What a hypothesis of the fused estimator expects of a phase: torque, and stretch.

A phase of steady motion (messages.features.Phase) measures two quantities, with s the direction, x
the table position, a and v acceleration and speed of the motor::

    torque    (1 + e) u = (J + R^2 dM) a + D v + A |v|
                          + s (k (1 + f) m(x) p + R G + R r(x) + B + St(v)) + b + J (w1 - w0) / T
    stretch   R theta - x = g0 + g1 (x - x0) + map(x) + h(x) + s odd(x) + T R v
                            + (c0 + c1 (x - x0) - cn) F + 3 F0 cn y(F, m(x) p)
                            + s chi (c0 + c1 (x - x0)) k (1 + f) p / R - l [F < 0]
                            + ec cos(x / R) + es sin(x / R)
              F = (M + dM) R a + s (G + r(x)) + V R v

w0 and w1 are errors of the speed at both ends of the phase's T; the next phase begins with w1.
The first is the balance of momentum (4.3.4) with the screw's drag proportional to its preload
(4.3.6); the second is the series stiffness under a known inertia force, of which only the nut's
share y depends on the preload (5.3.1, 5.3.11; see nut_deflection); ec and es are an encoder off its
centre. The functions run compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math
from typing import NamedTuple

from ..messages.samples import Floats
from ..models.compiled import inlined
from .fused_state import (
    ASYMMETRY,
    BEGUN,
    DRY,
    ENDED,
    GAIN,
    GAP,
    GROWTH,
    GUIDE,
    LUBE,
    MASS,
    NUT,
    OFFSET,
    PLAY,
    PRELOAD,
    RUB_NODES,
    SKEW,
    SLIDE,
    STATES,
    TURN_COS,
    TURN_SIN,
    VISCOUS,
    WIND_UP_SHARE,
    FusedModel,
    Reading,
)

_LEAST_PERCENT = 0.02
_LOOSE_PERCENT = 0.15
FLOATING_N = 15.0
_TURN_POINTS = 8
_TURN_ERROR = 0.1
_CROSSING_S = 0.01
"""Of a play, when the table begins to push."""


@inlined
def nut_deflection(load_n: float, percent: float, model: FusedModel) -> tuple[float, float, float]:
    """How far a preloaded pair of nuts yields, over the fresh pair's own preload deflection d0.

    Two opposed Hertz contacts, F = c ((q + y)^1.5 - (q - y)^1.5), with y = d / d0 and
    q = (p / p0)^(2/3); for small loads the stiffness is 3 F0 q^0.5 / d0, the cube root law of
    (5.3.11). Without preload the pair has a clearance, q < 0.

    Returns:
        y, dy/dF 1/N and dy/dp 1/%.
    """
    lost = model.clearance_share * math.exp(-max(percent, 0.0) / _LOOSE_PERCENT)
    share = max(percent, _LEAST_PERCENT) / model.fresh_percent
    q = math.pow(share, 2.0 / 3.0) - lost
    q_slope = 2.0 / 3.0 * math.pow(share, -1.0 / 3.0) / model.fresh_percent + lost / _LOOSE_PERCENT
    force = abs(load_n) / model.fresh_preload_n
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
    by_force = 1.0 / (1.5 * (up + down) * model.fresh_preload_n)
    return sign * y, by_force, -sign * (up - down) / (up + down) * q_slope


@inlined
def stroke_factor(model: FusedModel, table_m: float) -> float:
    """m(x): preload at a place over its mean over the stroke."""
    factor = 1.0
    if math.isnan(table_m):
        return factor
    for k in range(model.stroke_map.shape[0]):
        phase = 2.0 * math.pi * (k + 1) * table_m / model.stroke_m
        factor += model.stroke_map[k, 0] * math.cos(phase)
        factor += model.stroke_map[k, 1] * math.sin(phase)
    return factor


@inlined
def mapped(nodes_m: Floats, stroke_m: float, table_m: float) -> float:
    """Value at a place of a broken line with even nodes from 0 to the stroke, m."""
    left, share = _between(nodes_m.shape[0], stroke_m, table_m)
    if left < 0:
        return 0.0
    return float((1.0 - share) * nodes_m[left] + share * nodes_m[left + 1])


@inlined
def _between(count: int, stroke_m: float, table_m: float) -> tuple[int, float]:
    """The node before a place and the share of the one behind; -1 without nodes or place."""
    if count < 2 or math.isnan(table_m):
        return -1, 0.0
    place = min(max(table_m / stroke_m, 0.0), 1.0) * (count - 1)
    left = min(int(place), count - 2)
    return left, place - left


class NearNodes(NamedTuple):
    """Indices of the nodes before a place, -1 without any, and shares of those behind."""

    growth: int
    growth_share: float
    rub: int
    rub_share: float


class Spot(NamedTuple):
    """What the place and the speed of a phase say, whatever has happened to the axis."""

    factor: float  # m(x)
    stribeck_nm: float
    map_m: float  # map(x) + s odd(x)
    near: NearNodes


@inlined
def spot_of(model: FusedModel, r: Reading, size: int) -> Spot:
    """The spot of a phase for states of `size`."""
    map_m = mapped(model.lead_map_m, model.stroke_m, r.table_m)
    map_m += r.direction * mapped(model.wind_up_map_m, model.stroke_m, r.table_m)
    near = near_nodes(model, r, size)
    return Spot(stroke_factor(model, r.table_m), stribeck(model, r), map_m, near)


@inlined
def predict_torque(model: FusedModel, x: Floats, r: Reading, spot: Spot, slope: Floats) -> float:
    """Torque of a phase, N m, and its derivatives by the state into `slope` (n,)."""
    ratio = model.ratio_m_per_rad
    per_percent = model.drag_per_percent_nm * spot.factor
    for i in range(x.shape[0]):
        slope[i] = 0.0
    slope[PRELOAD] = r.direction * per_percent * (1.0 + x[LUBE])
    slope[DRY] = r.direction
    slope[GUIDE] = r.direction * ratio
    slope[VISCOUS] = r.speed_rad_s
    slope[ASYMMETRY] = abs(r.speed_rad_s)
    slope[MASS] = ratio * ratio * r.acceleration_rad_s2
    slope[OFFSET] = 1.0
    slope[GAIN] = -r.torque_nm
    if model.edge_rad2_s2 > 0.0:
        slope[ENDED] = model.inertia_kg_m2 / r.steady_s
        slope[BEGUN] = -slope[ENDED]
    value = model.inertia_kg_m2 * r.acceleration_rad_s2 + r.direction * spot.stribeck_nm
    for i in range(STATES):
        value += slope[i] * x[i]
    near = spot.near
    if near.rub >= 0:
        slope[near.rub] = r.direction * ratio * (1.0 - near.rub_share)
        slope[near.rub + 1] = r.direction * ratio * near.rub_share
        value += slope[near.rub] * x[near.rub] + slope[near.rub + 1] * x[near.rub + 1]
    slope[LUBE] = r.direction * per_percent * x[PRELOAD]
    return value


@inlined
def stribeck(model: FusedModel, r: Reading) -> float:
    """St(v): excess of the friction at slow motion, N m."""
    if model.stribeck_nm == 0.0:
        return 0.0
    return model.stribeck_nm * math.exp(-abs(r.speed_rad_s) / model.stribeck_speed_rad_s)


@inlined
def predict_stretch(
    model: FusedModel, x: Floats, r: Reading, spot: Spot, slope: Floats
) -> tuple[float, float]:
    """Stretch of a phase, m, and the compliance there, m/N; derivatives into `slope`."""
    away = r.table_m - model.reference_m
    local = spot.factor
    gear = model.ratio_m_per_rad * r.acceleration_rad_s2
    speed = model.ratio_m_per_rad * r.speed_rad_s
    load = table_load(model, x, r, spot.near)
    fresh_n = r.direction * WIND_UP_SHARE * model.drag_per_percent_nm / model.ratio_m_per_rad
    wound_n = fresh_n * (1.0 + x[LUBE])
    y, by_force, by_percent = nut_deflection(load, x[PRELOAD] * local, model)
    nut_m = 3.0 * model.fresh_preload_n
    rest = model.compliance_m_per_n + model.compliance_slope_per_n * away - x[NUT]
    rest = max(rest, 1e-12)
    compliance = rest + nut_m * x[NUT] * by_force
    for i in range(x.shape[0]):
        slope[i] = 0.0
    slope[GAP] = 1.0
    slope[GROWTH] = away
    slope[SKEW] = speed
    slope[SLIDE] = compliance * speed
    slope[GUIDE] = compliance * r.direction
    slope[MASS] = compliance * gear
    slope[NUT] = nut_m * y - load
    series = model.compliance_m_per_n + model.compliance_slope_per_n * away
    slope[PRELOAD] = nut_m * x[NUT] * by_percent * local + series * wound_n
    slope[LUBE] = series * fresh_n * x[PRELOAD]
    value = series * wound_n * x[PRELOAD]
    value += x[GAP] + x[GROWTH] * away + x[SKEW] * speed + rest * load + nut_m * x[NUT] * y
    value += spot.map_m
    slope[PLAY] = -carried_back(load)
    value += slope[PLAY] * x[PLAY]
    if x[TURN_COS] != 0.0 or x[TURN_SIN] != 0.0:
        slope[TURN_COS], slope[TURN_SIN] = mean_turn(model, r)
        value += slope[TURN_COS] * x[TURN_COS] + slope[TURN_SIN] * x[TURN_SIN]
    near = spot.near
    if near.growth >= 0:
        i, share = near.growth, near.growth_share
        slope[i], slope[i + 1] = 1.0 - share, share
        value += (1.0 - share) * x[i] + share * x[i + 1]
        slope[near.rub] = slope[GUIDE] * (1.0 - near.rub_share)
        slope[near.rub + 1] = slope[GUIDE] * near.rub_share
    return value, compliance


@inlined
def table_load(model: FusedModel, x: Floats, r: Reading, near: NearNodes) -> float:
    """F, N."""
    rubbing = x[GUIDE]
    if near.rub >= 0:
        rubbing += (1.0 - near.rub_share) * x[near.rub] + near.rub_share * x[near.rub + 1]
    gear = model.ratio_m_per_rad * r.acceleration_rad_s2
    speed = model.ratio_m_per_rad * r.speed_rad_s
    return float((model.table_mass_kg + x[MASS]) * gear + r.direction * rubbing + x[SLIDE] * speed)


@inlined
def carried_back(load_n: float) -> float:
    """[F < 0]; a half where hardly any force says which flank carries."""
    if abs(load_n) < FLOATING_N:
        return 0.5
    return 1.0 if load_n < 0.0 else 0.0


@inlined
def mean_turn(model: FusedModel, r: Reading) -> tuple[float, float]:
    """Means of cosine and sine of the motor's angle over a phase at a constant acceleration."""
    cosine, sine = 0.0, 0.0
    for k in range(_TURN_POINTS):
        t = r.steady_s * ((k + 0.5) / _TURN_POINTS - 0.5)
        angle = r.table_m / model.ratio_m_per_rad + r.speed_rad_s * t
        angle += 0.5 * r.acceleration_rad_s2 * (t * t - r.steady_s * r.steady_s / 12.0)
        cosine += math.cos(angle) / _TURN_POINTS
        sine += math.sin(angle) / _TURN_POINTS
    return cosine, sine


@inlined
def flank_variance(r: Reading, play_m: float, play_var: float, back: float) -> float:
    """Variance of the stretch by where in its play the table lies, m^2; `back` is [F < 0].

    A table that pushes has just crossed the play, which takes a part of the phase.
    """
    share = 0.0
    if back == 0.5:
        share = 0.5
    elif back == (1.0 if r.direction > 0.0 else 0.0):
        share = min(_CROSSING_S / r.steady_s, 0.5)
    return share * share * (play_m * play_m + play_var)


@inlined
def turn_variance(x: Floats, p: Floats, r: Reading) -> float:
    """Variance of the stretch by where within a phase an encoder off its centre has been, m^2."""
    if x[TURN_COS] == 0.0 and x[TURN_SIN] == 0.0:
        return 0.0
    share = _TURN_ERROR * min(0.5 * abs(r.speed_rad_s) * r.steady_s, 1.0)
    square = x[TURN_COS] * x[TURN_COS] + x[TURN_SIN] * x[TURN_SIN]
    square += p[TURN_COS, TURN_COS] + p[TURN_SIN, TURN_SIN]
    return float(share * share * square)


@inlined
def near_nodes(model: FusedModel, r: Reading, size: int) -> NearNodes:
    """Where in a state of `size` a phase's nodes are."""
    count = size - STATES - RUB_NODES
    left, share = _between(count, model.stroke_m, r.table_m)
    if left < 0:
        return NearNodes(-1, 0.0, -1, 0.0)
    rub, rub_share = _between(RUB_NODES, model.stroke_m, r.table_m)
    return NearNodes(STATES + left, share, STATES + count + rub, rub_share)
