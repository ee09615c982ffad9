"""Robust regression of means over phases of motion (Huber 1964), with priors.

The noise is learned along; stated priors decide where the recording determines nothing.
"""

from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from .steady_phases import SteadyPhases

HUBER = 2.0
SLOW_RAD_S = (0.0, 1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 35.0, 60.0)


@dataclass(frozen=True, slots=True)
class Noise:
    """Error of a mean over a phase: variance density (1 + (slow / |v|)^2) / steady time.

    Friction that changes along the way (cogging, Stribeck) averages out the worse the slower the
    axis moves.
    """

    density: float
    slow_rad_s: float

    def variance(self, steady_s: Floats, speed_rad_s: Floats) -> Floats:
        """Variance of means over `steady_s` at `speed_rad_s`, (n,)."""
        return self.density * slowness(self.slow_rad_s, speed_rad_s) / steady_s


def slowness(slow_rad_s: float, speed_rad_s: Floats) -> Floats:
    """1 + (slow / |v|)^2, (n,)."""
    return np.asarray(1.0 + (slow_rad_s / np.maximum(np.abs(speed_rad_s), 1e-3)) ** 2)


@dataclass(frozen=True, slots=True)
class RegressionFit:
    """Weighted least squares with priors.

    Attributes:
        value, covariance: of the parameters, (p,) and (p, p).
        residual: of the rows, (n,).
        noise: learned from the residual.
    """

    value: Floats
    covariance: Floats
    residual: Floats
    noise: Noise

    @property
    def sigma(self) -> Floats:
        """Standard deviations of the parameters, (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def robust_regression(
    columns: Floats, wanted: Floats, phases: SteadyPhases, prior_sigma: Floats
) -> RegressionFit:
    """Regression of means over phases, with zero-mean priors on the parameters.

    Args:
        columns: (n, p).
        wanted: (n,).
        phases: of the rows.
        prior_sigma: (p,), inf for none.
    """
    steady_s, speed = phases.steady_s, phases.speed_rad_s
    noise, trust = Noise(1.0, 0.0), np.ones_like(wanted)
    for _ in range(12):
        root = np.sqrt(trust / noise.variance(steady_s, speed))
        scaled = columns * root[:, None]
        normal = scaled.T @ scaled + np.diag(prior_sigma**-2.0)
        covariance = np.asarray(np.linalg.pinv(normal, hermitian=True), dtype=np.float64)
        value = covariance @ (scaled.T @ (root * wanted))
        residual = wanted - columns @ value
        noise = _noise_of(residual, phases)
        z = np.abs(residual) / np.sqrt(noise.variance(steady_s, speed))
        trust = np.minimum(1.0, HUBER / np.maximum(z, 1e-12))
    return RegressionFit(value, covariance, residual, noise)


def _noise_of(residual: Floats, phases: SteadyPhases) -> Noise:
    """Most likely noise: its growth at slow motion, then its level."""
    energy = residual**2 * phases.steady_s
    energy = np.minimum(energy, 25.0 * max(float(np.median(energy)) / 0.455, 1e-40))
    best: tuple[float, Noise] | None = None
    for slow in SLOW_RAD_S:
        shape = slowness(slow, phases.speed_rad_s)
        white = max(float(np.mean(energy / shape)), 1e-40)
        cost = float(np.sum(np.log(white * shape)))
        if best is None or cost < best[0]:
            best = cost, Noise(white, slow)
    assert best is not None
    noise = best[1]
    return Noise(max(noise.density, _lasting(residual, phases, noise.slow_rad_s)), noise.slow_rad_s)


def _lasting(residual: Floats, phases: SteadyPhases, slow_rad_s: float) -> float:
    """Density from weighted sums over about a second: errors of friction outlast a phase."""
    weight = phases.steady_s / slowness(slow_rad_s, phases.speed_rad_s)
    z = residual * np.sqrt(weight)
    bound = 4.0 * 1.4826 * float(np.median(np.abs(z)))
    clipped = np.clip(z, -bound, bound) * np.sqrt(weight)
    _, index = np.unique(np.floor(phases.time_s) + 1e7 * phases.run, return_inverse=True)
    sums, lengths = np.bincount(index, clipped), np.bincount(index, weight)
    return float(np.sum(sums**2) / np.sum(lengths))
