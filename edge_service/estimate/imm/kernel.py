"""Steps of an interacting filter bank with two states and two measurements, compiled.

Mix, predict, update, weigh, combine. Nothing is allocated per step, and a live step is a run of
one. Mode probabilities are kept as logarithms, because the likelihood of a mode far from the truth
underflows. A mode is a row (x1, x2, P11, P12, P22); 2 x 2 matrices are tuples in row order.
"""

import math
from typing import NamedTuple

import numpy as np

from ...messages.samples import Floats
from ...models.compiled import compiled

Pair = tuple[float, float]
Matrix = tuple[float, float, float, float]  # a11, a12, a21, a22
Symmetric = tuple[float, float, float]  # s11, s12, s22

LOG_2PI = math.log(2.0 * math.pi)
TINY_PROBABILITY = 1e-200
"""Below this, sums of probabilities are formed in logs."""


class Model(NamedTuple):
    """Parameters common to the steps of a run (see LinearStep), and the rule for the gain.

    With `sliding`, the gains are those of the sliding innovation filter (eq. 4.4.10), from C^+ and
    delta; otherwise Kalman gains (thesis, eq. 4.4.4).
    """

    transition: Matrix
    process_noise: Symmetric
    observation: Matrix
    measurement_noise: Symmetric
    mode_transition: Floats  # (r, r)
    sliding: bool
    boundary: Pair
    pseudo_inverse: Matrix


class History(NamedTuple):
    """Outputs of N steps: log mu_j, log Lambda_j, NIS (N, r), and the combined mode (N, 5)."""

    log_probability: Floats
    log_likelihood: Floats
    nis: Floats
    combined: Floats


@compiled
def apply(a: Matrix, x: Pair) -> Pair:
    """A x."""
    return a[0] * x[0] + a[1] * x[1], a[2] * x[0] + a[3] * x[1]


@compiled
def add(s: Symmetric, t: Symmetric) -> Symmetric:
    """S + T."""
    return s[0] + t[0], s[1] + t[1], s[2] + t[2]


@compiled
def multiply(a: Matrix, s: Symmetric) -> Matrix:
    """A S."""
    return (
        a[0] * s[0] + a[1] * s[1],
        a[0] * s[1] + a[1] * s[2],
        a[2] * s[0] + a[3] * s[1],
        a[2] * s[1] + a[3] * s[2],
    )


@compiled
def congruence(a: Matrix, s: Symmetric) -> Symmetric:
    """A S A^T."""
    left = multiply(a, s)
    return (
        left[0] * a[0] + left[1] * a[1],
        left[0] * a[2] + left[1] * a[3],
        left[2] * a[2] + left[3] * a[3],
    )


@compiled
def one_minus_product(a: Matrix, b: Matrix) -> Matrix:
    """I - A B."""
    return (
        1.0 - a[0] * b[0] - a[1] * b[2],
        -a[0] * b[1] - a[1] * b[3],
        -a[2] * b[0] - a[3] * b[2],
        1.0 - a[2] * b[1] - a[3] * b[3],
    )


@compiled
def weigh(log_probability: Floats, mode_transition: Floats, to: int, weight: Floats) -> float:
    """Fill mu_{i|j} (thesis, eq. 4.4.13) for j = `to`; return log cbar_j (4.4.14).

    `weight` comes in as mu_i (r,). A mode that cannot be reached (-inf) is not mixed.
    """
    total = 0.0
    for i in range(len(weight)):
        weight[i] *= mode_transition[i, to]
        total += weight[i]
    largest = 0.0
    if total < TINY_PROBABILITY:
        largest = -math.inf
        for i in range(len(weight)):
            share = mode_transition[i, to]
            weight[i] = math.log(share) + log_probability[i] if share > 0.0 else -math.inf
            largest = max(largest, weight[i])
        total = 0.0
        for i in range(len(weight)):
            if largest > -math.inf:
                weight[i] = math.exp(weight[i] - largest)
            else:
                weight[i] = 1.0 if i == to else 0.0
            total += weight[i]
    weight *= 1.0 / total
    return largest + math.log(total)


@compiled
def combine(weight: Floats, modes: Floats, out: Floats) -> None:
    """Moments of a mixture (5,): (eqs. 4.4.15-16) with mixing weights, (4.4.21-22) with mu_j."""
    mean1 = mean2 = 0.0
    for i in range(len(weight)):
        mean1 += weight[i] * modes[i, 0]
        mean2 += weight[i] * modes[i, 1]
    p11 = p12 = p22 = 0.0
    for i in range(len(weight)):
        d1, d2 = modes[i, 0] - mean1, modes[i, 1] - mean2
        p11 += weight[i] * (modes[i, 2] + d1 * d1)
        p12 += weight[i] * (modes[i, 3] + d1 * d2)
        p22 += weight[i] * (modes[i, 4] + d2 * d2)
    out[0], out[1], out[2], out[3], out[4] = mean1, mean2, p11, p12, p22


@compiled
def sliding_gain(pseudo_inverse: Matrix, boundary: Pair, innovation: Pair) -> Matrix:
    """K = C^+ sat(|e| / delta) (thesis, eq. 4.4.10)."""
    share1 = min(1.0, abs(innovation[0]) / boundary[0])
    share2 = min(1.0, abs(innovation[1]) / boundary[1])
    return (
        pseudo_inverse[0] * share1,
        pseudo_inverse[1] * share2,
        pseudo_inverse[2] * share1,
        pseudo_inverse[3] * share2,
    )


@compiled
def filter_mode(model: Model, drive: Floats, measurement: Pair, mode: Floats) -> Pair:
    """Predict (thesis, eqs. 4.4.1-2) and update one mode (5,) in place, with a drive (2,).

    The covariance takes the Joseph form (thesis, eq. 4.4.6), which is good for any gain (4.4.12).

    Returns:
        log Lambda_j (eq. 4.4.17) and the NIS; NaN if S is not positive definite. (4.4.18) needs the
        exponent -NIS / 2.
    """
    moved = apply(model.transition, (mode[0], mode[1]))
    state = (moved[0] + drive[0], moved[1] + drive[1])
    covariance = add(congruence(model.transition, (mode[2], mode[3], mode[4])), model.process_noise)
    expected = apply(model.observation, state)
    innovation = (measurement[0] - expected[0], measurement[1] - expected[1])
    spread = add(congruence(model.observation, covariance), model.measurement_noise)
    determinant = spread[0] * spread[2] - spread[1] * spread[1]
    if not (determinant > 0.0 and spread[0] > 0.0):
        return math.nan, math.nan
    scale = 1.0 / determinant
    precision = (spread[2] * scale, -spread[1] * scale, spread[0] * scale)
    if model.sliding:
        gain = sliding_gain(model.pseudo_inverse, model.boundary, innovation)
    else:  # K = P_{k+1|k} C^T S^-1 (thesis, eq. 4.4.4)
        seen = multiply(model.observation, covariance)
        gain = multiply((seen[0], seen[2], seen[1], seen[3]), precision)
    shift = apply(gain, innovation)
    mode[0], mode[1] = state[0] + shift[0], state[1] + shift[1]
    mode[2], mode[3], mode[4] = add(
        congruence(one_minus_product(gain, model.observation), covariance),
        congruence(gain, model.measurement_noise),
    )
    whitened = apply((precision[0], precision[1], precision[1], precision[2]), innovation)
    nis = whitened[0] * innovation[0] + whitened[1] * innovation[1]
    return -0.5 * (nis + math.log(determinant)) - LOG_2PI, nis


@compiled
def normalise(log_probability: Floats, probability: Floats) -> None:
    """Subtract log c, c = sum_j Lambda_j cbar_j, in place; fill mu_j (r,).

    Thesis eq. 4.4.20 as printed leaves cbar_j out, which lets the probabilities decay to zero.
    """
    largest = -math.inf
    for j in range(len(log_probability)):
        largest = max(largest, log_probability[j])
    total = 0.0
    for j in range(len(log_probability)):
        total += math.exp(log_probability[j] - largest)
    log_sum = largest + math.log(total)
    for j in range(len(log_probability)):
        log_probability[j] -= log_sum
        probability[j] = math.exp(log_probability[j])


@compiled
def run(
    model: Model, inputs: tuple[Floats, Floats], modes: Floats, logs: Floats, history: History
) -> int:
    """Run over N steps.

    Args:
        inputs: drives (N, r, 2) and measurements (N, 2).
        modes, logs: state of the bank, (r, 5) and log mu_j (r,), moved on in place.
        history: filled.

    Returns:
        The number of steps done; less than N if an innovation covariance is not positive definite.
    """
    drives, measurements = inputs
    mode_transition = model.mode_transition
    size = len(modes)
    mixed, weight, probability = np.empty((size, 5)), np.empty(size), np.empty(size)
    for j in range(size):
        probability[j] = math.exp(logs[j])
    for k in range(len(drives)):
        measurement = (measurements[k, 0], measurements[k, 1])
        for j in range(size):
            weight[:] = probability
            history.log_probability[k, j] = weigh(logs, mode_transition, j, weight)
            combine(weight, modes, mixed[j])
        for j in range(size):
            log_likelihood, nis = filter_mode(model, drives[k, j], measurement, mixed[j])
            if not math.isfinite(log_likelihood):
                return k
            history.log_likelihood[k, j], history.nis[k, j] = log_likelihood, nis
            logs[j] = history.log_probability[k, j] + log_likelihood
            modes[j] = mixed[j]
        normalise(logs, probability)
        history.log_probability[k] = logs
        combine(probability, modes, history.combined[k])
    return len(drives)
