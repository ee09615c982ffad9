"""Likelihood of a phase with and without a process force, by hypothesis.

A force F on the table shows as R F in the torque and as F times the compliance in the stretch. It
may begin, with any size, or last from the phase before with about the same one.
"""

import math
from typing import NamedTuple

import numpy as np

from ....messages.samples import Floats
from ....models.compiled import compiled, inlined
from ..state import FASTEST_RAD_S, AxisModel, Bank, Process, Reading
from .innovation import Innovation

FORCED = 0.2
"""Probability of a process force above which a phase corrects nothing."""
OUTLIER = 20.0
"""Normalised innovation squared beyond which a hypothesis has no explanation: its likelihood has
a tail flatter than a normal distribution's, and the phase corrects it little or not at all."""
_RAPID = 0.4
_ALIKE = 0.5
_NEVER = 1e-12


class Assessments(NamedTuple):
    """Assessment of one phase by all hypotheses, each (HYPOTHESES,).

    Attributes:
        nis: normalised innovation squared without a force.
        forced: probability of a force.
        persists: probability of the force of the phase before.
        misfit: half of the excess of the innovation squared under that force over 2, its mean.
        log_likelihood: of the phase; -inf of a hypothesis that is not alive.
    """

    nis: Floats
    forced: Floats
    persists: Floats
    misfit: Floats
    log_likelihood: Floats


@compiled
def empty_assessments(size: int) -> Assessments:
    """Assessments to be filled in, of `size` hypotheses."""
    return Assessments(
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        np.zeros(size),
        np.full(size, -math.inf),
    )


@inlined
def force_begins(bank: Bank, process: Process, r: Reading) -> float:
    """Probability that a process force begins: hardly in a rapid."""
    speed = abs(r.speed_rad_s)
    fastest = max(bank.moments[FASTEST_RAD_S], speed)
    bank.moments[FASTEST_RAD_S] = fastest
    return process.rapid_share if speed > _RAPID * fastest else process.force_share


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
    ratio, force_var = model.ratio_m_per_rad, process.force_n * process.force_n
    uu, ss, us = s[0, 0], s[1, 1], s[0, 1]
    seen_n = e[0] / ratio
    if two:
        a, b = ss * ratio - us * compliance, uu * compliance - us * ratio
        seen_n = (a * e[0] + b * e[1]) / (a * ratio + b * compliance)
    doubt_m = process.force_error * seen_n * compliance
    extra_uu, extra_us = force_var * ratio * ratio, force_var * ratio * compliance
    extra_ss = force_var * compliance * compliance + doubt_m * doubt_m
    stays = process.force_stay * bank.force[k]
    alike = _ALIKE * stays if two else 0.0
    starts = (1.0 - bank.force[k]) * begins + stays - alike
    calm, nis = _log_likelihood(e[0], e[1], uu, ss, us)
    new, _ = _log_likelihood(e[0], e[1], uu + extra_uu, ss + extra_ss, us + extra_us)
    a, b = bank.force_n[k] * ratio, bank.force_n[k] * compliance
    share = process.force_error * process.force_error
    same, nis_same = _log_likelihood(
        e[0] - a, e[1] - b, uu + share * a * a, ss + 2.0 * share * b * b, us + share * a * b
    )
    calm += math.log(1.0 - starts - alike)
    new += math.log(max(starts, _NEVER))
    same += math.log(max(alike, _NEVER))
    top = max(calm, new, same)
    total = top + math.log(math.exp(calm - top) + math.exp(new - top) + math.exp(same - top))
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
