"""Expected torque and stretch of a hypothesis in a phase of steady motion, and its innovation.

With s the direction, x the table position, a and v acceleration and speed of the motor, and the
preload p = exp(PRELOAD)::

    torque    (1 + scale) (J a + R^2 M a + D (1 + viscous) v + A |v| + offset + s wander
              + s (k p (1 + nut) + k p0 (m(x) - 1) + B (1 + bearing) + R G (1 + guide)
                   + St(v)) + J (w1 - w0) / T)
    stretch   R theta - x = g0 + g1 (x - x0) + map(x) + s odd(x) + skew R v + wander
              + (c(x) - cn) F + loose (F + H) + coupling (F + H + s drag / R)
              + 3 F0 cn (y(F + H, m(x) p) - y(H, p0)) + s c(x) G reversal
              F = (M0 + (1 - table mass) M) R a + s G (1 + guide) + V (1 + guide viscous) R v

H is what hangs on the screw, gravity less the counterweight; an amplifier's offset passes for it;
c(x) = c0 + c1 (x - x0) + c2 (x - x0)^2 is the compliance and m(x) the unevenness of the friction.
The first is the balance of momentum (eq. 4.3.4) with the screw's drag proportional to its preload
(eq. 4.3.6); the second is the series stiffness under a known inertia force, of which only the nut's
share y depends on the preload (5.3.1, 5.3.11; see nut_deflection). No recording of a healthy axis
can split what else differs between the directions (wind-up under the nut's drag, seals, play): it
is a state of its own. The functions run compiled, and as plain Python (`.py_func`) alike.
"""

import math
from typing import NamedTuple

from ...messages.samples import Floats
from ...models.compiled import inlined
from ...models.screw.friction import stribeck_decay
from ...models.screw.nut_law import nut_deflection
from . import state
from .state import AxisModel, Bank, Process, Reading

_STRAIGHT = 0.05
_STRIBECK_ERROR = 0.3
_TOLD = 2.0
"""Standard deviations of the torque from which on an inertia torque is told from noise. Less tells
nothing of a mass: friction that varies accelerates an axis without a torque, and so do time stamps
that jitter."""
UNEVEN_LOST = 0.5
"""Assumption: of the friction's unevenness along the stroke, what goes with the preload (sigma)."""
STEADY_PLAY = 0.2
"""Assumption: of a lost nut's play, what varies where even motion or weight keep it on one side."""
_decay = inlined(stribeck_decay)


@inlined
def stroke_factor(model: AxisModel, table_m: float) -> float:
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
    count = nodes_m.shape[0]
    if count < 2 or math.isnan(table_m):
        return 0.0
    place = min(max(table_m / stroke_m, 0.0), 1.0) * (count - 1)
    left = min(int(place), count - 2)
    share = place - left
    return float((1.0 - share) * nodes_m[left] + share * nodes_m[left + 1])


@inlined
def stribeck(model: AxisModel, r: Reading) -> float:
    """St(v): excess of the friction at slow motion, N m."""
    if model.stribeck_nm == 0.0:
        return 0.0
    return model.stribeck_nm * _decay(r.speed_rad_s, model.stribeck_speed_rad_s)


@inlined
def expected_torque(
    model: AxisModel, x: Floats, r: Reading, factor: float, slow_nm: float, slope: Floats
) -> float:
    """Torque of a phase, N m, and its derivatives by the state into `slope` (n,).

    Args:
        factor: m(x) at the phase's place.
        slow_nm: St(v).
    """
    ratio, s = model.ratio_m_per_rad, r.direction
    drag = model.drag_per_percent_nm * math.exp(x[state.PRELOAD])
    slope[:] = 0.0
    slope[state.PRELOAD] = s * drag * (1.0 + x[state.NUT_FRICTION])
    slope[state.NUT_FRICTION] = s * drag
    slope[state.BEARING_FRICTION] = s * model.bearing_nm
    slope[state.GUIDE_FRICTION] = s * ratio * model.guide_n
    slope[state.VISCOUS] = model.viscous_nm_s * r.speed_rad_s
    slope[state.PAYLOAD] = ratio * ratio * r.acceleration_rad_s2
    slope[state.TORQUE_OFFSET] = 1.0
    slope[state.TORQUE_WANDER] = s
    if model.edge_rad2_s2 > 0.0:
        slope[state.SPEED_ERROR_END] = model.inertia_kg_m2 / r.steady_s
        slope[state.SPEED_ERROR_START] = -slope[state.SPEED_ERROR_END]
    value = model.inertia_kg_m2 * r.acceleration_rad_s2
    value += s * (slow_nm + model.bearing_nm + ratio * model.guide_n)
    value += model.viscous_nm_s * r.speed_rad_s + model.asymmetry_nm_s * abs(r.speed_rad_s)
    uneven_nm = model.drag_per_percent_nm * model.fresh_percent * (factor - 1.0)
    value += slope[state.PRELOAD] + s * uneven_nm
    for i in range(state.BEARING_FRICTION, state.SPEED_ERROR_END + 1):
        value += slope[i] * x[i]
    for i in range(state.TORQUE_SCALE):
        slope[i] *= 1.0 + x[state.TORQUE_SCALE]
    slope[state.TORQUE_SCALE] = value
    return float(value * (1.0 + x[state.TORQUE_SCALE]))


@inlined
def expected_stretch(
    model: AxisModel, x: Floats, r: Reading, factor: float, slope: Floats
) -> tuple[float, float]:
    """Stretch of a phase, m, and the compliance there, m/N; derivatives into `slope` (n,)."""
    away, s = r.table_m - model.reference_m, r.direction
    gear = model.ratio_m_per_rad * r.acceleration_rad_s2
    speed, percent = model.ratio_m_per_rad * r.speed_rad_s, math.exp(x[state.PRELOAD])
    guide = s * model.guide_n
    load = (model.table_mass_kg + x[state.PAYLOAD] * (1.0 - x[state.TABLE_MASS])) * gear
    load += guide * (1.0 + x[state.GUIDE_FRICTION])
    load += model.guide_viscous_n_s * (1.0 + x[state.GUIDE_VISCOUS]) * speed
    nut_n = s * model.drag_per_percent_nm * percent / model.ratio_m_per_rad
    bearing_n = s * model.bearing_nm / model.ratio_m_per_rad
    viscous_n = model.viscous_nm_s * r.speed_rad_s / model.ratio_m_per_rad
    held = load + model.hanging_n
    twisting = held + nut_n * (1.0 + x[state.NUT_FRICTION])
    twisting += bearing_n * (1.0 + x[state.BEARING_FRICTION])
    twisting += viscous_n * (1.0 + x[state.VISCOUS])
    twisting += model.screw_kg_m2 * r.acceleration_rad_s2 / model.ratio_m_per_rad
    y, by_force, by_percent = nut_deflection(
        held, percent * factor, model.fresh_percent, model.fresh_preload_n, model.clearance_share
    )
    y -= model.hanging_deflection
    nut_m = 3.0 * model.fresh_preload_n
    series = model.compliance_m_per_n + model.compliance_slope_per_n * away
    series += model.compliance_bow_per_n_m * away * away
    rest = max(series - x[state.NUT_COMPLIANCE], 1e-12)
    compliance = rest + x[state.LOOSENESS] + x[state.COUPLING]
    compliance += nut_m * x[state.NUT_COMPLIANCE] * by_force
    reversal = s * series * model.guide_n
    slope[:] = 0.0
    slope[state.PRELOAD] = nut_m * x[state.NUT_COMPLIANCE] * by_percent * percent * factor
    slope[state.PRELOAD] += x[state.COUPLING] * nut_n * (1.0 + x[state.NUT_FRICTION])
    slope[state.NUT_FRICTION] = x[state.COUPLING] * nut_n
    slope[state.BEARING_FRICTION] = x[state.COUPLING] * bearing_n
    slope[state.VISCOUS] = x[state.COUPLING] * viscous_n
    slope[state.GUIDE_FRICTION] = compliance * guide
    slope[state.GUIDE_VISCOUS] = compliance * model.guide_viscous_n_s * speed
    slope[state.PAYLOAD] = compliance * gear * (1.0 - x[state.TABLE_MASS])
    slope[state.NUT_COMPLIANCE] = nut_m * y - load
    slope[state.LOOSENESS] = held
    slope[state.COUPLING] = twisting
    slope[state.TABLE_MASS] = -compliance * x[state.PAYLOAD] * gear
    slope[state.REVERSAL] = reversal
    slope[state.ENCODER_OFFSET], slope[state.ENCODER_SLOPE] = 1.0, away
    slope[state.CLOCK_SKEW], slope[state.STRETCH_WANDER] = speed, 1.0
    value = reversal * x[state.REVERSAL] + rest * load + nut_m * x[state.NUT_COMPLIANCE] * y
    value += x[state.LOOSENESS] * held + x[state.COUPLING] * twisting
    value += x[state.ENCODER_OFFSET] + x[state.ENCODER_SLOPE] * away + x[state.CLOCK_SKEW] * speed
    value += x[state.STRETCH_WANDER]
    value += mapped(model.lead_map_m, model.stroke_m, r.table_m)
    value += s * mapped(model.wind_up_map_m, model.stroke_m, r.table_m)
    for j in range(state.MAP_STATES):
        slope[state.MAP + j] = math.cos((j + 2) * math.pi * r.table_m / model.stroke_m)
        value += slope[state.MAP + j] * x[state.MAP + j]
    return value, compliance


class Innovation(NamedTuple):
    """Innovation of torque and stretch, in arrays that are filled again for each hypothesis."""

    slopes: Floats  # H, (2, n)
    gains: Floats  # P H', (2, n)
    error: Floats  # (2,), N m and m
    covariance: Floats  # S, (2, 2)
    at: Floats  # (n,), a point of the rule; scratch after that
    points: Floats  # (3, 2), torque and stretch at its points


class Noise(NamedTuple):
    """Errors of a phase, independent of the hypothesis."""

    factor: float  # m(x)
    slow_nm: float  # St(v)
    torque_var: float
    stretch_var: float
    accelerates: bool  # by more than noise


@inlined
def noise_of(model: AxisModel, r: Reading) -> Noise:
    """Errors of one phase by its length and speed."""
    speed, slow_nm = max(abs(r.speed_rad_s), 1e-3), stribeck(model, r)
    torque = model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
    stretch = model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    torque += (_STRIBECK_ERROR * slow_nm) ** 2
    inertia_nm = model.inertia_kg_m2 * r.acceleration_rad_s2
    accelerates = inertia_nm * inertia_nm > _TOLD * _TOLD * torque
    return Noise(stroke_factor(model, r.table_m), slow_nm, torque, stretch, accelerates)


@inlined
def innovate(
    bank: Bank,
    k: int,
    model: AxisModel,
    process: Process,
    r: Reading,
    noise: Noise,
    two: bool,
    innovation: Innovation,
) -> float:
    """Fill the innovation of hypothesis `k`; returns the compliance at the phase, m/N.

    Torque and stretch are linear as a regression over what the preload may be tells (statistical
    linearisation): three points of Gauss and Hermite's rule, each with the state that is likely
    there; what bends is noise. A slope taken where this phase leads would go with its error, and
    walk along what the data cannot tell. Axial friction that differs from phase to phase acts on
    both by the commissioned compliance: noise of a hypothesis' own would favour the stiffest.
    """
    x, p, compliance = bank.mean[k], bank.covariance[k], 0.0
    slopes, gains, e, s, at, points = innovation
    swings_n = abs(model.table_mass_kg * model.ratio_m_per_rad * r.acceleration_rad_s2)
    swings = noise.accelerates and model.guide_n + swings_n > abs(model.hanging_n)
    var = p[state.PRELOAD, state.PRELOAD]
    wide = two and var > _STRAIGHT * _STRAIGHT
    side, end, away = (1, 1.0 / 6.0, math.sqrt(3.0 / var)) if wide else (0, 0.0, 0.0)
    slopes[:], points[:], s[:] = 0.0, 0.0, 0.0
    e[0], e[1] = r.torque_nm, r.stretch_m if two else 0.0
    for n in range(-side, side + 1):
        weight = end if n else 1.0 - 2.0 * end
        for i in range(x.shape[0]):
            at[i] = x[i] + n * away * p[state.PRELOAD, i]
        percent = math.exp(at[state.PRELOAD])
        points[n, 0] = expected_torque(model, at, r, noise.factor, noise.slow_nm, gains[0])
        lost_nm = model.drag_per_percent_nm * (model.fresh_percent - percent)
        s[0, 0] += weight * (UNEVEN_LOST * lost_nm * (noise.factor - 1.0)) ** 2
        if two:
            points[n, 1], yields = expected_stretch(model, at, r, noise.factor, gains[1])
            compliance += weight * yields
            loose_m = process.loose_m * math.exp(-percent / 0.3) * (1.0 if swings else STEADY_PLAY)
            s[1, 1] += weight * loose_m * loose_m
        for q in range(1 + two):
            e[q] -= weight * points[n, q]
            for i in range(x.shape[0]):
                slopes[q, i] += weight * gains[q, i]
    for q in range(2):
        if wide:
            across = 0.5 * (points[1, q] - points[-1, q])
            across -= away * along(slopes[q], p[state.PRELOAD])
            slopes[q, state.PRELOAD] += across / (away * var)
        points[0, q] = math.sqrt(end / 3.0) * (points[1, q] + points[-1, q] - 2.0 * points[0, q])
        slopes[q, state.PAYLOAD] *= noise.accelerates
        _project(p, slopes[q], gains[q])
    bend_nm, bend_m = points[0]
    axial_nm = process.axial_n * model.ratio_m_per_rad
    axial_m = two * process.axial_n * model.compliance_m_per_n
    s[0, 0] += noise.torque_var + axial_nm**2 + bend_nm**2 + along(slopes[0], gains[0])
    s[1, 1] += (noise.stretch_var if two else 1.0) + axial_m**2 + bend_m**2
    s[1, 1] += along(slopes[1], gains[1])
    s[0, 1] = s[1, 0] = axial_nm * axial_m + bend_nm * bend_m + along(slopes[1], gains[0])
    return compliance


@inlined
def _project(p: Floats, slope: Floats, gain: Floats) -> None:
    """P H' of one quantity, from the rows on which it depends."""
    gain[:] = 0.0
    for i in range(gain.shape[0]):
        weight = slope[i]
        if weight != 0.0:
            for j in range(gain.shape[0]):
                gain[j] += weight * p[i, j]


@inlined
def along(slope: Floats, gain: Floats) -> float:
    total = 0.0
    for i in range(slope.shape[0]):
        total += slope[i] * gain[i]
    return total
