"""One hypothesis by matrices: x' = F x, P' = F P F' + Q, and Schmidt's correction."""

import math

import numpy as np

from edge_service.estimate.mixture import physics, state
from edge_service.estimate.mixture.model import Start
from edge_service.estimate.mixture.state import AxisModel, Bank, Process, Reading, empty_bank
from edge_service.messages.samples import Floats

from .mixture_axis import SETTINGS

FRICTIONS = range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1)
CONSIDERED = (state.NUT_COMPLIANCE,)
GROWTH_S = 300.0
USUAL, WIDE = 6.0, 0.05
TORQUE_S, WAY_M = SETTINGS.wander_s, SETTINGS.wander_m


def motion_of(
    model: AxisModel, process: Process, r: Reading, elapsed_s: float, x: Floats, p: Floats | None
) -> tuple[Floats, Floats]:
    """F and Q between two phases of a steady preload, from the state before and its covariance.

    Without one the state is exact. What returns to zero has F = exp(-t / T), Q = sigma^2 (1 - F^2).
    """
    size = len(x)
    f, q = np.eye(size), np.zeros((size, size))
    keep = math.exp(-elapsed_s / SETTINGS.friction_s)
    block = slice(FRICTIONS[0], FRICTIONS[-1] + 1)
    q[block, block] = SETTINGS.together**2 * (1.0 - keep**2)
    for i in FRICTIONS:
        f[i, i] = keep
        q[i, i] += SETTINGS.apart**2 * (1.0 - keep**2)
    keep = math.exp(-r.steady_s / TORQUE_S)
    f[state.TORQUE_WANDER, state.TORQUE_WANDER] = keep
    q[state.TORQUE_WANDER, state.TORQUE_WANDER] = process.torque_wander_nm**2 * (1.0 - keep**2)
    f[state.PRELOAD, state.WEAR_RATE] = r.steady_s
    q[state.WEAR_RATE, state.WEAR_RATE] = SETTINGS.rate_walk**2 * r.steady_s
    if size > state.TORQUE_STATES:
        keep = math.exp(-abs(r.speed_rad_s) * model.ratio_m_per_rad * r.steady_s / WAY_M)
        f[state.STRETCH_WANDER, state.STRETCH_WANDER] = keep
        doubt = 0.0 if p is None else p[state.ENCODER_SLOPE, state.ENCODER_SLOPE]
        slope = math.sqrt(x[state.ENCODER_SLOPE] ** 2 + doubt)
        finer_m = SETTINGS.uneven_share * slope * model.stroke_m
        nodes_m = np.linspace(0.0, model.stroke_m, len(model.map_sigma_m))
        unknown_m = float(np.interp(r.table_m, nodes_m, model.map_sigma_m))
        wander_m2 = process.stretch_wander_m**2 + finer_m**2 + unknown_m**2
        q[state.STRETCH_WANDER, state.STRETCH_WANDER] = wander_m2 * (1.0 - keep**2)
        f[state.REVERSAL, state.REVERSAL] = math.exp(-elapsed_s / SETTINGS.friction_s)
        keep = math.exp(-elapsed_s / GROWTH_S)
        for place, rate in (
            (state.ENCODER_OFFSET, state.OFFSET_RATE),
            (state.ENCODER_SLOPE, state.SLOPE_RATE),
        ):
            f[rate, rate], f[place, rate] = keep, GROWTH_S * (1.0 - keep)
    for i in range(size):
        if i not in FRICTIONS:
            q[i, i] += process.walk[i] * _walked_s(i, elapsed_s)
    return f, q


def _walked_s(i: int, elapsed_s: float) -> float:
    """Time over which an element's walk is summed: a thermal one settles, as int exp(-2 t / T)."""
    time_s = GROWTH_S if i >= state.TORQUE_STATES and i != state.REVERSAL else SETTINGS.friction_s
    return 0.5 * time_s * -math.expm1(-2.0 * elapsed_s / time_s)


def expected(model: AxisModel, x: Floats, r: Reading) -> tuple[Floats, Floats, float]:
    """Torque and stretch (2,), their slopes (2, n), and the compliance; one without an encoder."""
    slopes, factor = np.zeros((2, len(x))), physics.stroke_factor(model, r.table_m)
    values = [physics.expected_torque(model, x, r, factor, physics.stribeck(model, r), slopes[0])]
    if len(x) == state.TORQUE_STATES or math.isnan(r.stretch_m):
        return np.array(values), slopes[:1], 0.0
    stretch, compliance = physics.expected_stretch(model, x, r, factor, slopes[1])
    return np.array([*values, stretch]), slopes, compliance


def regressed(
    model: AxisModel, process: Process, x: Floats, p: Floats, r: Reading
) -> tuple[Floats, Floats, Floats]:
    """Torque and stretch as a regression over the preload tells: mean, slopes and what is left.

    The rest of the state follows the preload as the covariance tells. With one encoder, around x.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    if len(expected(model, x, r)[0]) == 1 or p[0, 0] < WIDE**2:
        nodes, weights = np.zeros(1), np.ones(1)
    weights, sigma = weights / np.sum(weights), math.sqrt(p[0, 0])
    points = [x + node * p[:, 0] / sigma for node in nodes]
    values = np.array([expected(model, point, r)[0] for point in points])
    slopes = np.average([expected(model, point, r)[1] for point in points], 0, weights)
    mean, quantities = weights @ values, values.shape[1]
    noise = np.average([noise_of(model, process, y, r, quantities) for y in points], 0, weights)
    if len(nodes) > 1:
        whole = (weights * nodes) @ values
        slopes[:, 0] += (whole - slopes @ p[:, 0] / sigma) / sigma
        left = values - mean - np.outer(nodes, whole)
        noise += left.T @ (weights[:, None] * left)
    return mean, slopes, noise


def noise_of(model: AxisModel, process: Process, x: Floats, r: Reading, quantities: int) -> Floats:
    """Covariance of what one phase errs by, (m, m): sensors, slow motion, axial friction, play."""
    speed = abs(r.speed_rad_s)
    torque = model.torque_density * (1.0 + (model.torque_slow_rad_s / speed) ** 2) / r.steady_s
    lost_nm = model.drag_per_percent_nm * (model.fresh_percent - math.exp(x[state.PRELOAD]))
    torque += (physics.UNEVEN_LOST * lost_nm * (physics.stroke_factor(model, r.table_m) - 1.0)) ** 2
    noise = np.diag([torque + (0.3 * physics.stribeck(model, r)) ** 2, 0.0])
    stretch = model.stretch_density * (1.0 + (model.stretch_slow_rad_s / speed) ** 2) / r.steady_s
    loose = process.loose_m * math.exp(-math.exp(x[state.PRELOAD]) / 0.3)
    inertia_nm = abs(model.inertia_kg_m2 * r.acceleration_rad_s2)
    swings_n = abs(model.table_mass_kg * model.ratio_m_per_rad * r.acceleration_rad_s2)
    swings = abs(model.hanging_n) < swings_n + model.guide_n
    swings &= inertia_nm > 2.0 * math.sqrt(noise[0, 0])
    loose *= 1.0 if swings else physics.STEADY_PLAY
    noise[1, 1] = stretch + loose**2
    axial = process.axial_n * np.array([model.ratio_m_per_rad, model.compliance_m_per_n])
    return (noise + np.outer(axial, axial))[:quantities, :quantities]


def corrected(
    model: AxisModel, process: Process, x: Floats, p: Floats, r: Reading
) -> tuple[Floats, Floats, float]:
    """State, covariance, and the innovation squared; what is considered is known, give or take.

    With it known, the gain is Kalman's. What it errs by (variance v) has moved the state by d, and
    moves it now by (I - K H) d. Where the innovation squared is above USUAL, S is scaled by their
    ratio. The state is then projected onto a preload that a nut can have; no joint is stiffer than
    when it was new.
    """
    foreseen, slopes, noise = regressed(model, process, x, p, r)
    seen = np.array([r.torque_nm, r.stretch_m])[: len(foreseen)]
    error = seen - foreseen
    s = slopes @ p @ slopes.T + noise
    nis = float(error @ np.linalg.solve(s, error))
    s *= max(1.0, nis / USUAL)
    one = CONSIDERED if len(x) > state.TORQUE_STATES else ()
    v = p[np.ix_(one, one)]
    d = p[:, one] @ np.linalg.inv(v)
    known = p - d @ v @ d.T
    s_known = s - slopes @ d @ v @ d.T @ slopes.T
    gain = np.linalg.solve(s_known, slopes @ known).T
    known = known - gain @ s_known @ gain.T
    d = d - gain @ slopes @ d
    p = known + d @ v @ d.T
    x = x + gain @ error
    if len(x) > state.TORQUE_STATES:
        x[state.LOOSENESS] = max(x[state.LOOSENESS], 0.0)
        x[state.COUPLING] = max(x[state.COUPLING], 0.0)
    return bounded(model, x, p), p, nis


def bounded(model: AxisModel, x: Floats, p: Floats) -> Floats:
    """Likeliest state with a preload that a nut can have: least (y - x)' P^-1 (y - x), by Lagrange.

    What is considered stays; all is in standard deviations, of what varies.
    """
    most = math.log(state.MOST_SHARE * model.fresh_percent)
    if x[state.PRELOAD] <= most:
        return x
    sigma = np.sqrt(np.diag(p))
    free = [i for i in range(len(x)) if sigma[i] > 0.0]
    if len(x) > state.TORQUE_STATES:
        free = [i for i in free if i not in CONSIDERED]
    system, right = np.zeros((len(free) + 1, len(free) + 1)), np.zeros(len(free) + 1)
    system[:-1, :-1] = np.linalg.inv(p[np.ix_(free, free)] / np.outer(sigma[free], sigma[free]))
    row = free.index(state.PRELOAD)
    system[-1, row] = system[row, -1] = 1.0
    right[-1] = (most - x[state.PRELOAD]) / sigma[state.PRELOAD]
    y = x.copy()
    y[free] += sigma[free] * np.linalg.solve(system, right)[:-1]
    return y


def alone(start: Start, sigma: float) -> Bank:
    """A bank in which only the steady belief lives, and goes on alone while it learns."""
    bank = empty_bank(len(start.mean))
    bank.mean[state.STEADY], bank.covariance[state.STEADY] = start.mean, start.covariance
    bank.covariance[state.STEADY, state.PRELOAD, state.PRELOAD] = sigma**2
    bank.log_weight[state.STEADY], bank.alive[state.STEADY] = 0.0, 1
    bank.moments[state.LEARNING] = 1.0
    return bank


def never(process: Process) -> Process:
    """Nothing happens to the axis, no force acts, and the bank learns for ever."""
    nothing = np.full(state.HYPOTHESES, -np.inf)
    assumed = process.assumed._replace(
        force_share=1e-300, rapid_share=1e-300, force_stay=0.0, learn_s=math.inf
    )
    return process._replace(assumed=assumed, priors=nothing, stop_priors=nothing)


def unit(p: Floats) -> Floats:
    """The covariance over its standard deviations, of what varies."""
    sigma = np.sqrt(np.diag(p))
    there = sigma > 0.0
    return np.asarray(p[np.ix_(there, there)] / np.outer(sigma[there], sigma[there]))
