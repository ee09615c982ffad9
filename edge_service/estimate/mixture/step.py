"""Step of the bank over one phase of motion: predict, weigh with and without a process force,
correct by phases free of force, and adapt the set of hypotheses.

A force F on the table shows as R F in the torque and as F times the compliance in the stretch. It
may begin, with any size, or last from the phase before with about the same one.

The functions run compiled; their plain Python (`.py_func`) gives the same numbers.
"""

import math
from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled, inlined
from . import state
from .hypotheses import FORCED, STOP_S, accepted, adapt_hypotheses, leader_of, normalise
from .physics import Innovation, along, innovate, mapped, noise_of
from .state import AxisModel, Bank, Process, Reading

_INERTIA_S = 30.0
_MOST_INERTIA_ERROR = 0.4
"""Of one phase's inertia torque: a cut must not speak for the rest."""
_USUAL = 6.0
"""Innovation squared that two quantities exceed in 5 % of all phases."""
OUTLIER = 20.0
"""Normalised innovation squared beyond which a hypothesis has no explanation: its likelihood has
a tail flatter than a normal distribution's, and the phase corrects it little or not at all."""
_RAPID, _ALIKE = 0.4, 0.5
_USUAL_SIGMA, _SHIFTED_SIGMA, _SHIFTED_M = 3.0, 8.0, 5e-6
RAPID_MEMORY_S = 8.0
"""Rapid motion over which the share of process forces in it is averaged."""
_NEVER, _LEAST_PERCENT = 1e-12, 0.02
_LEAST_FRICTION, _MOST_FRICTION = -0.7, 3.0


class Assessments(NamedTuple):
    """Assessment of one phase by all hypotheses, each (HYPOTHESES,)."""

    nis: Floats  # normalised innovation squared without a force
    forced: Floats  # probability of a force
    persists: Floats  # probability of the force of the phase before
    misfit: Floats  # half of what the innovation squared under that force is above 2, its mean
    log_likelihood: Floats  # -inf of a hypothesis that is not alive


@compiled
def step(bank: Bank, model: AxisModel, process: Process, r: Reading, elapsed_s: float) -> float:
    """Predict, weigh and correct every hypothesis, in place, `elapsed_s` after the phase before.

    Returns the normalised innovation squared per quantity of the leading hypothesis, about 1 is
    expected; NaN if it takes the phase for one under a process force, which corrects nothing.
    """
    size = bank.mean.shape[1]
    two = size > state.TORQUE_STATES and not math.isnan(r.stretch_m)
    slopes, gains, points = np.zeros((2, size)), np.zeros((2, size)), np.zeros((3, 2))
    innovation = Innovation(slopes, gains, np.zeros(2), np.eye(2), np.zeros(size), points)
    noise, speed = noise_of(model, r), abs(r.speed_rad_s)
    bank.moments[state.FASTEST_RAD_S] = max(bank.moments[state.FASTEST_RAD_S], speed)
    rapid = speed > _RAPID * bank.moments[state.FASTEST_RAD_S]
    begins = process.assumed.rapid_share if rapid else process.assumed.force_share  # of forces
    hypotheses = bank.mean.shape[0]
    zeros = np.zeros((5, hypotheses))
    log_likelihood, error_nm = np.full(hypotheses, -math.inf), zeros[4]
    assessed = Assessments(zeros[0], zeros[1], zeros[2], zeros[3], log_likelihood)
    for k in range(hypotheses):
        if bank.alive[k] == 0:
            continue
        _drift(bank, k, model, process, r, elapsed_s)
        compliance = innovate(bank, k, model, process, r, noise, two, innovation)
        if two and elapsed_s > STOP_S and _is_shifted(innovation):
            at = state.ENCODER_OFFSET
            bank.covariance[k, at, at] += innovation.error[1] * innovation.error[1]
            compliance = innovate(bank, k, model, process, r, noise, two, innovation)
        read_kg_m2 = bank.mean[k, state.TORQUE_SCALE] * model.inertia_kg_m2
        error_nm[k] = innovation.error[0] + read_kg_m2 * r.acceleration_rad_s2
        assess(bank, k, model, process, begins, compliance, two, innovation, assessed)
        _correct_unforced(bank, k, model, assessed, two, innovation)
    _reweigh(bank, process, assessed, rapid)
    leader = leader_of(bank)
    counts = (1.0 - assessed.persists[leader]) * noise.accelerates
    _watch_inertia(bank, model, r, leader, error_nm[leader], counts)
    calm = bool(assessed.forced[leader] <= FORCED)
    bank.moments[state.SURPRISE] = assessed.nis[leader]
    adapt_hypotheses(bank, process, r, elapsed_s, calm, assessed.nis)
    _count_forced(bank, process, r.steady_s, rapid, calm)
    acts, forced_s = bank.force[accepted(bank)] > FORCED, bank.moments[state.BELIEVED_FORCED_S]
    bank.moments[state.PAST_FORCED_S] *= math.exp(-r.steady_s / process.assumed.friction_s)
    bank.moments[state.PAST_FORCED_S] += 0.0 if acts else forced_s
    bank.moments[state.BELIEVED_FORCED_S] = forced_s + r.steady_s if acts else 0.0
    return float(assessed.nis[leader] / (2.0 if two else 1.0)) if calm else math.nan


@inlined
def _is_shifted(innovation: Innovation) -> bool:
    """Return whether the linear encoder has got another zero: the stretch errs, the torque not."""
    e, s = innovation.error, innovation.covariance
    usual = e[0] * e[0] < _USUAL_SIGMA * _USUAL_SIGMA * s[0, 0]
    far = e[1] * e[1] > _SHIFTED_SIGMA * _SHIFTED_SIGMA * s[1, 1]
    return bool(usual and far and abs(e[1]) > _SHIFTED_M)


@inlined
def _drift(bank: Bank, k: int, model: AxisModel, process: Process, r: Reading, dt_s: float) -> None:
    """Predict a hypothesis over the time since the phase before, in place."""
    x, p = bank.mean[k], bank.covariance[k]
    keep = math.exp(-dt_s / process.assumed.friction_s)
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        _fade(x, p, i, keep)
    spread = process.together * (1.0 - keep * keep) / 2.0 * process.assumed.friction_s
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        for j in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
            p[i, j] += spread
    if x.shape[0] > state.TORQUE_STATES:
        _fade(x, p, state.REVERSAL, keep)
    keep = math.exp(-r.steady_s / process.assumed.wander_s)
    _fade(x, p, state.TORQUE_WANDER, keep)
    p[state.TORQUE_WANDER, state.TORQUE_WANDER] += process.torque_wander_nm**2 * (1.0 - keep * keep)
    if model.edge_rad2_s2 > 0.0:
        _pass_on(x, p, model.edge_rad2_s2, r.follows)
    if x.shape[0] > state.TORQUE_STATES:
        way_m = abs(r.speed_rad_s) * model.ratio_m_per_rad * r.steady_s
        keep = math.exp(-way_m / process.assumed.wander_m)
        _fade(x, p, state.STRETCH_WANDER, keep)
        slope2 = x[state.ENCODER_SLOPE] ** 2 + p[state.ENCODER_SLOPE, state.ENCODER_SLOPE]
        uneven_m2 = (process.assumed.uneven_share * model.stroke_m) ** 2 * slope2
        unknown_m = mapped(model.map_sigma_m, model.stroke_m, r.table_m)
        wander_m2 = process.stretch_wander_m**2 + uneven_m2 + unknown_m**2
        p[state.STRETCH_WANDER, state.STRETCH_WANDER] += wander_m2 * (1.0 - keep * keep)
        keep = math.exp(-dt_s / process.assumed.growth_s)
        grown_s = process.assumed.growth_s * (1.0 - keep)
        _grow(x, p, state.ENCODER_OFFSET, state.OFFSET_RATE, grown_s)
        _grow(x, p, state.ENCODER_SLOPE, state.SLOPE_RATE, grown_s)
        _fade(x, p, state.OFFSET_RATE, keep)
        _fade(x, p, state.SLOPE_RATE, keep)
        if k == state.LOOSENING:
            for i in (state.LOOSENESS, state.COUPLING):
                p[i, i] += process.jumps[k, i, i] * r.steady_s / process.assumed.loosening_s
    back_s = _settled_s(process.assumed.friction_s, dt_s)
    warm_s = _settled_s(process.assumed.growth_s, dt_s)
    for i in range(x.shape[0]):
        returns = i < state.TORQUE_STATES or i == state.REVERSAL
        p[i, i] += process.walk[i] * (back_s if returns else warm_s)
    if p[state.WEAR_RATE, state.WEAR_RATE] > 0.0:
        _grow(x, p, state.PRELOAD, state.WEAR_RATE, r.steady_s)
        p[state.WEAR_RATE, state.WEAR_RATE] += process.assumed.rate_walk**2 * r.steady_s
    if k == state.WEARING:
        p[state.PRELOAD, state.PRELOAD] += process.assumed.wear_walk**2 * r.steady_s


@inlined
def _settled_s(keep_s: float, elapsed_s: float) -> float:
    """Time whose noise a state holds that returns with a time constant, s: elapsed_s if short."""
    return 0.5 * keep_s * (1.0 - math.exp(-2.0 * elapsed_s / keep_s))


@inlined
def _fade(x: Floats, p: Floats, i: int, keep: float) -> None:
    """Let an element of the state return to zero by a factor."""
    x[i] *= keep
    for j in range(x.shape[0]):
        p[i, j] *= keep
        p[j, i] *= keep


@inlined
def _grow(x: Floats, p: Floats, i: int, rate: int, time_s: float) -> None:
    """Let an element of the state run at its rate."""
    x[i] += time_s * x[rate]
    for j in range(x.shape[0]):
        p[i, j] += time_s * p[rate, j]
    for j in range(x.shape[0]):
        p[j, i] += time_s * p[j, rate]


@inlined
def _pass_on(x: Floats, p: Floats, edge_rad2_s2: float, follows: bool) -> None:
    """Begin a phase with the speed's error at the end of the one before, or with a new one."""
    first, last = state.SPEED_ERROR_START, state.SPEED_ERROR_END
    x[first] = x[last] if follows else 0.0
    x[last] = 0.0
    for j in range(x.shape[0]):
        p[first, j] = p[last, j] if follows else 0.0
        p[j, first] = p[j, last] if follows else 0.0
    p[first, first] = p[last, last] if follows else edge_rad2_s2
    p[last, :], p[:, last] = 0.0, 0.0
    p[last, last] = edge_rad2_s2


@inlined
def _correct_unforced(
    bank: Bank, k: int, model: AxisModel, assessed: Assessments, two: bool, innovation: Innovation
) -> None:
    """Correct a hypothesis by a phase free of process forces.

    A phase that it cannot explain does not correct it, except the likeliest one: that gives way by
    a little, or it would stand still where it errs, as after a long cut. A phase counts by the
    probability that no force acts, and no less: to widen it by the force that might act would
    discount exactly those phases that carry news.
    """
    forced, wild = assessed.forced[k], assessed.nis[k] > OUTLIER
    if forced <= FORCED and (not wild or k == leader_of(bank)):
        scale = max(1.0, assessed.nis[k] / _USUAL) / (1.0 - forced)
        correct(bank, k, model, scale, two, innovation)


@inlined
def _reweigh(bank: Bank, process: Process, assessed: Assessments, rapid: bool) -> None:
    """Update the weights by the likelihoods of a phase; no phase alone rules a hypothesis out.

    Those that take it for one under a force gain or lose alike: the axis' compliance under a force
    is known too badly to choose among them. While a force lasts, only the misfit to it counts, not
    how closely a rival that learns expects it: but of a total loss, which it mimics, and in rapids.
    Improbable frictions count in full: they are assumed once, and errors that outlast a phase do
    not excuse them.
    """
    most, forced, share = -math.inf, 0.0, 1e-99
    lasts, said = not rapid or bank.moments[state.LEARNING] > 0.0, assessed.log_likelihood
    for k in range(bank.alive.shape[0]):
        most = max(most, said[k])
    for k in range(bank.alive.shape[0]):
        if bank.alive[k]:
            behind = min(most - said[k], process.assumed.most_nats)
            stays = assessed.persists[k] if lasts and k != state.TOTAL_LOSS else 0.0
            behind -= stays * max(behind - assessed.misfit[k], 0.0)
            said[k] = -process.assumed.evidence * behind
            weight = math.exp(bank.log_weight[k]) * (assessed.forced[k] > FORCED)
            share, forced = share + weight, forced + weight * said[k]
    for k in range(bank.alive.shape[0]):
        if bank.alive[k]:
            cost = (1.0 - process.assumed.evidence) * _improbability(bank.mean[k], process)
            gain = forced / share if assessed.forced[k] > FORCED else said[k]
            bank.log_weight[k] += gain + bank.cost[k] - cost
            bank.cost[k] = cost
    normalise(bank, process.assumed.floor)


@inlined
def _improbability(x: Floats, process: Process) -> float:
    """Half of the squared distance of the frictions from commissioned ones, by what they may do."""
    assumed = process.assumed
    together, apart = assumed.together * assumed.together, assumed.apart * assumed.apart
    if together <= 0.0 or apart <= 0.0:
        return 0.0
    total, square = 0.0, 0.0
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        total += x[i]
        square += x[i] * x[i]
    distance = (square - together * total * total / (apart + 5.0 * together)) / apart
    if x.shape[0] > state.TORQUE_STATES:
        distance += (x[state.REVERSAL] / assumed.reversal) ** 2
        distance += ((x[state.TABLE_MASS] - assumed.twist) / process.mass_sigma) ** 2
    return float(0.5 * distance)


@inlined
def _watch_inertia(
    bank: Bank, model: AxisModel, r: Reading, leader: int, error_nm: float, counts: float
) -> None:
    """Accumulate the correlation of the torque's error with the inertia torque.

    A wrong torque constant errs alike in every phase, and passes for a force that begins anew in
    each. A process force errs by as much as the inertia torque in some, and lasts into the next:
    `counts` is the probability that none does. The leader's payload is part of the sum.
    """
    keep = math.exp(-r.steady_s / _INERTIA_S)
    inertia_nm = model.inertia_kg_m2 * r.acceleration_rad_s2
    square, most = inertia_nm * inertia_nm, _MOST_INERTIA_ERROR * inertia_nm * inertia_nm
    bank.moments[state.INERTIA_ERROR] *= keep
    bank.moments[state.INERTIA_TORQUE] *= keep
    load_nm = bank.mean[leader, state.PAYLOAD] * model.ratio_m_per_rad**2 * r.acceleration_rad_s2
    error = min(max(error_nm * inertia_nm, -most), most) + load_nm * inertia_nm
    bank.moments[state.INERTIA_ERROR] += counts * error * r.steady_s
    bank.moments[state.INERTIA_TORQUE] += counts * square * r.steady_s


@inlined
def _count_forced(bank: Bank, process: Process, steady_s: float, rapid: bool, calm: bool) -> None:
    """Time for which a force has lasted, updated; doubted at intervals as if the axis had stopped.

    Another load or lubricant may look like a force, and one in rapids is none of a process.
    """
    if rapid:
        keep = math.exp(-steady_s / RAPID_MEMORY_S)
        bank.moments[state.RAPID_S] = keep * bank.moments[state.RAPID_S] + steady_s
        forced_s = keep * bank.moments[state.RAPID_FORCED_S] + (0.0 if calm else steady_s)
        bank.moments[state.RAPID_FORCED_S] = forced_s
    if calm:
        bank.moments[state.FORCED_S] = 0.0
        return
    before_s = bank.moments[state.FORCED_S]
    bank.moments[state.FORCED_S] = before_s + steady_s
    if bank.moments[state.FORCED_S] % process.assumed.doubt_s < before_s % process.assumed.doubt_s:
        bank.moments[state.STOPPED_S] = max(bank.moments[state.STOPPED_S], 1.0)


@compiled
def assess(
    bank: Bank,
    k: int,
    model: AxisModel,
    process: Process,
    begins: float,
    compliance: float,
    two: bool,
    innovation: Innovation,
    assessed: Assessments,
) -> None:
    """Assess a phase under hypothesis `k`, into `assessed`, and keep the force it would be.

    With one encoder a torque alone fits any force, so none is recognised again.
    """
    e, s = innovation.error, innovation.covariance
    uu, ss, us, ratio = s[0, 0], s[1, 1], s[0, 1], model.ratio_m_per_rad
    seen_n = e[0] / ratio
    if two:
        a, b = ss * ratio - us * compliance, uu * compliance - us * ratio
        seen_n = (a * e[0] + b * e[1]) / (a * ratio + b * compliance)
    doubt = (process.assumed.force_error * seen_n * compliance) ** 2
    stays = process.assumed.force_stay * bank.force[k]
    alike = _ALIKE * stays if two else 0.0
    starts = (1.0 - bank.force[k]) * begins + stays - alike
    calm, nis = _log_likelihood(e[0], e[1], uu, ss, us)
    new = -math.inf
    for share in (1.0, process.assumed.force_small):
        a, b = share * process.force_n * ratio, share * process.force_n * compliance
        one, _ = _log_likelihood(e[0], e[1], uu + a * a, ss + b * b + doubt, us + a * b)
        new = np.logaddexp(new, one)
    a, b = bank.force_n[k] * ratio, bank.force_n[k] * compliance
    share = process.assumed.force_error * process.assumed.force_error
    same, nis_same = _log_likelihood(
        e[0] - a, e[1] - b, uu + share * a * a, ss + 2.0 * share * b * b, us + share * a * b
    )
    calm += math.log(1.0 - starts - alike)
    new += math.log(max(0.5 * starts, _NEVER))
    same += math.log(max(alike, _NEVER))
    total = np.logaddexp(np.logaddexp(calm, new), same)
    assessed.nis[k], assessed.log_likelihood[k] = nis, total
    assessed.persists[k] = math.exp(same - total)
    assessed.forced[k] = min(assessed.persists[k] + math.exp(new - total), 1.0)
    assessed.misfit[k] = max(0.5 * nis_same - 1.0, 0.0)
    bank.force[k], bank.force_n[k] = assessed.forced[k], seen_n


@inlined
def _log_likelihood(
    torque_nm: float, stretch_m: float, uu: float, ss: float, us: float
) -> tuple[float, float]:
    """Log-likelihood with tails that an outlier does not outrun, and the innovation squared."""
    det = uu * ss - us * us
    nis = (ss * torque_nm * torque_nm - 2.0 * us * torque_nm * stretch_m) / det
    nis += uu * stretch_m * stretch_m / det
    if nis > OUTLIER:
        return -0.5 * (OUTLIER * (1.0 + math.log(nis / OUTLIER)) + math.log(det)), nis
    return -0.5 * (nis + math.log(det)), nis


@inlined
def correct(
    bank: Bank, k: int, model: AxisModel, scale: float, two: bool, innovation: Innovation
) -> None:
    """Kalman correction with the innovation's covariance, scaled, as if the nut were known.

    What its compliance errs by is in the covariance by what it does to the state (Friedland 1969).
    Gains that count it (Schmidt's) take for news of the preload what changes the slopes alone.
    No nut has more preload than it was made with; no joint is stiffer than at commissioning.
    """
    x, p, e, s = bank.mean[k], bank.covariance[k], innovation.error, innovation.covariance
    size, v = x.shape[0], innovation.at
    both = size > state.TORQUE_STATES
    first, second = innovation.gains[0], innovation.gains[1]
    nut = p[state.NUT_COMPLIANCE, state.NUT_COMPLIANCE] if both else 0.0
    for i in range(size):
        v[i] = p[i, state.NUT_COMPLIANCE] / nut if nut > 0.0 else 0.0
    a, b = along(innovation.slopes[0], v), along(innovation.slopes[1], v) if two else 0.0
    left = math.sqrt(scale * s[0, 0] - nut * a * a)
    below = (scale * s[0, 1] - nut * a * b) / left
    right = math.sqrt(scale * s[1, 1] - nut * b * b - below * below)
    step, other = e[0] / left, (e[1] - below * e[0] / left) / right if two else 0.0
    for i in range(size):
        first[i] = (first[i] - nut * a * v[i]) / left
        second[i] = (second[i] - nut * b * v[i] - below * first[i]) / right if two else 0.0
        x[i] += first[i] * step + second[i] * other
    a, b = a / left, (b - below * a / left) / right
    for i in range(size):
        later = v[i] - first[i] * a - second[i] * b
        for j in range(size):
            p[i, j] -= first[i] * first[j] + second[i] * second[j]
            p[i, j] += nut * (later * (v[j] - first[j] * a - second[j] * b) - v[i] * v[j])
    if both:
        x[state.LOOSENESS] = max(x[state.LOOSENESS], 0.0)
        x[state.COUPLING] = max(x[state.COUPLING], 0.0)
    _bound(x, p, math.log(state.MOST_SHARE * model.fresh_percent), both)
    x[state.PRELOAD] = max(x[state.PRELOAD], math.log(_LEAST_PERCENT))
    for i in range(state.NUT_FRICTION, state.GUIDE_VISCOUS + 1):
        x[i] = min(max(x[i], _LEAST_FRICTION), _MOST_FRICTION)


@inlined
def _bound(x: Floats, p: Floats, most: float, both: bool) -> None:
    """Project a state onto ln(preload) <= `most`: the likeliest one there (Simon, Chia 2002).

    Clipping alone would leave the rest of the state as an impossible preload has made it.
    """
    if x[state.PRELOAD] <= most or p[state.PRELOAD, state.PRELOAD] <= 0.0:
        return
    share = (most - x[state.PRELOAD]) / p[state.PRELOAD, state.PRELOAD]
    for i in range(x.shape[0]):
        if not (both and i == state.NUT_COMPLIANCE):
            x[i] += share * p[state.PRELOAD, i]
