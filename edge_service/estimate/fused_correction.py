"""How likely an innovation is, with a process force and without; the Kalman correction by it."""

import math

from ..messages.samples import Floats
from ..models.compiled import inlined
from .fused_state import Innovation, Mixture

_FORCE_ERROR = 0.05


@inlined
def likelihood(e: Floats, s: Floats, two: bool) -> tuple[float, float]:
    """Log-likelihood and normalised innovation squared."""
    if not two:
        nis = e[0] * e[0] / s[0, 0]
        return -0.5 * (nis + math.log(2.0 * math.pi * s[0, 0])), nis
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    nis = (s[1, 1] * e[0] * e[0] - 2.0 * s[0, 1] * e[0] * e[1] + s[0, 0] * e[1] * e[1]) / det
    return -0.5 * (nis + math.log(4.0 * math.pi**2 * det)), nis


@inlined
def _force_seen(e: Floats, s: Floats, ratio: float, compliance: float, two: bool) -> float:
    """The force on the table that explains the innovation best, N."""
    if not two:
        return float(e[0] / ratio)
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    a = (s[1, 1] * ratio - s[0, 1] * compliance) / det
    b = (s[0, 0] * compliance - s[0, 1] * ratio) / det
    return float((a * e[0] + b * e[1]) / (a * ratio + b * compliance))


@inlined
def under_force(
    told: Innovation, forced: Floats, ratio: float, compliance: float, force_n: float, two: bool
) -> tuple[float, float]:
    """Log-likelihood with a process force of sigma `force_n`, and the force seen, N.

    The nut is no linear spring under a large force, hence a share of the compliance as error.
    `forced` is room to work in.
    """
    e, s = told.error, told.covariance
    seen = _force_seen(e, s, ratio, compliance, two)
    var = force_n * force_n
    forced[0, 0] = s[0, 0] + var * ratio * ratio + (_FORCE_ERROR * ratio * seen) ** 2
    forced[1, 1] = s[1, 1] + var * compliance * compliance
    forced[1, 1] += (_FORCE_ERROR * compliance * seen) ** 2
    forced[0, 1] = s[0, 1] + var * ratio * compliance
    forced[1, 0] = forced[0, 1]
    log_likelihood, _ = likelihood(e, forced, two)
    return log_likelihood, seen


@inlined
def correct(mixture: Mixture, k: int, told: Innovation, scale: float, two: bool) -> None:
    """Kalman correction of hypothesis k; `scale` widens the innovation of an outlier.

    With S = L L', P H' S^-1 H P = A A' for A = P H' L'^-1, which stays symmetric to the last bit.
    `told.gains` becomes A'.
    """
    x, p = mixture.mean[k], mixture.covariance[k]
    s = told.covariance
    first, second = told.gains[0], told.gains[1]
    left = math.sqrt(s[0, 0] * scale)
    step = told.error[0] / left
    for i in range(x.shape[0]):
        first[i] /= left
        x[i] += first[i] * step
    if not two:
        for i in range(x.shape[0]):
            a = first[i]
            for j in range(x.shape[0]):
                p[i, j] -= a * first[j]
        return
    below = s[0, 1] * scale / left
    det = max(s[0, 0] * s[1, 1] - s[0, 1] * s[0, 1], 1e-300)
    right = math.sqrt(det / s[0, 0] * scale)
    step = (told.error[1] - below * step) / right
    for i in range(x.shape[0]):
        second[i] = (second[i] - below * first[i]) / right
        x[i] += second[i] * step
    for i in range(x.shape[0]):
        a, b = first[i], second[i]
        if a == 0.0 and b == 0.0:
            continue
        for j in range(x.shape[0]):
            p[i, j] -= a * first[j] + b * second[j]
