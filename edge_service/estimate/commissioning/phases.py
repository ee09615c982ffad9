"""Steady phases of several recordings as columns of a regression, and that regression (Huber 1964).

The noise is learned along; stated priors decide where the recording determines nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from ...messages.features import FeatureBlock
from ...messages.samples import Floats
from ...models.steady_limits import SteadyLimits
from ..effect_compensation import EffectCompensation

HUBER = 2.0
SLOW_RAD_S = (0.0, 1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 35.0, 60.0)


class CommissioningError(ValueError):
    """Recordings cannot determine a parameter of the estimator; the text names the motion."""


@dataclass(frozen=True, slots=True)
class SteadyPhases:
    """Phases of several recordings as columns, (n,) each; `run` numbers the recording."""

    run: Floats
    time_s: Floats
    steady_s: Floats
    direction: Floats
    torque_nm: Floats
    acceleration_rad_s2: Floats
    speed_rad_s: Floats
    angle_rad: Floats
    table_m: Floats

    @classmethod
    def of(
        cls, recordings: Sequence[Sequence[FeatureBlock]], known: EffectCompensation | None = None
    ) -> "SteadyPhases":
        """Steady phases of usable blocks, without the known effects."""
        rows = []
        for run, blocks in enumerate(recordings):
            for block in blocks:
                direction, time_s = block.steady_direction, block.time_s
                for phase in block.phases if block.usable else ():
                    seen = known.compensated(phase, direction, time_s) if known else phase
                    motion = (seen.torque_nm, seen.acceleration_rad_s2, seen.speed_rad_s)
                    place = (seen.angle_rad, seen.table_m)
                    rows.append((run, time_s, phase.steady_s, direction, *motion, *place))
        return cls(*np.array(rows, dtype=np.float64).reshape(-1, 9).T)

    def at(self, places: npt.NDArray[np.intp | np.bool_]) -> "SteadyPhases":
        """Rows by index, places (m,), or by mask, (n,) bool."""
        return SteadyPhases(*(getattr(self, field.name)[places] for field in fields(self)))

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True)
class Noise:
    """Error of a mean over a phase: variance density (1 + (slow / |v|)^2) / steady time.

    Friction that changes along the way (cogging, Stribeck) averages out worse in slow motion.
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
    """Weighted least squares with priors."""

    value: Floats  # of the parameters, (p,)
    covariance: Floats  # (p, p)
    residual: Floats  # of the rows, (n,)
    noise: Noise  # learned from the residual

    @property
    def sigma(self) -> Floats:
        """Standard deviations of the parameters, (p,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def robust_regression(
    columns: Floats, wanted: Floats, phases: SteadyPhases, prior_sigma: Floats
) -> RegressionFit:
    """Regression of means over phases, (n, p) on (n,), with zero-mean priors (p,), inf for none."""
    steady_s, speed = phases.steady_s, phases.speed_rad_s
    noise, trust = Noise(1.0, 0.0), np.ones_like(wanted)
    for _ in range(12):
        root = np.sqrt(trust / noise.variance(steady_s, speed))
        scaled = columns * root[:, None]
        normal = scaled.T @ scaled + np.diag(prior_sigma**-2.0)
        covariance = np.asarray(np.linalg.pinv(normal, hermitian=True), dtype=np.float64)
        value = covariance @ (scaled.T @ (root * wanted))
        residual = wanted - columns @ value
        noise = noise_of(residual, phases)
        z = np.abs(residual) / np.sqrt(noise.variance(steady_s, speed))
        trust = np.minimum(1.0, HUBER / np.maximum(z, 1e-12))
    return RegressionFit(value, covariance, residual, noise)


def noise_of(residual: Floats, phases: SteadyPhases) -> Noise:
    """Most likely noise of a residual, (n,): its growth at slow motion, then its level."""
    energy = residual**2 * phases.steady_s
    energy = np.minimum(energy, 25.0 * max(float(np.median(energy)) / 0.455, 1e-40))
    found = []
    for slow in SLOW_RAD_S:
        shape = slowness(slow, phases.speed_rad_s)
        white = max(float(np.mean(energy / shape)), 1e-40)
        found.append((float(np.sum(np.log(white * shape))), slow, white))
    _, slow, density = min(found, key=lambda each: each[0])
    return Noise(max(density, _lasting(residual, phases, slow)), slow)


def _lasting(residual: Floats, phases: SteadyPhases, slow_rad_s: float) -> float:
    """Density from weighted sums over about a second: errors of friction outlast a phase."""
    weight = phases.steady_s / slowness(slow_rad_s, phases.speed_rad_s)
    z = residual * np.sqrt(weight)
    bound = 4.0 * 1.4826 * float(np.median(np.abs(z)))
    clipped = np.clip(z, -bound, bound) * np.sqrt(weight)
    _, index = np.unique(np.floor(phases.time_s) + 1e7 * phases.run, return_inverse=True)
    sums, lengths = np.bincount(index, clipped), np.bincount(index, weight)
    return float(np.sum(sums**2) / np.sum(lengths))


def place_columns(phases: SteadyPhases) -> Floats:
    """Torques of the place alone (cable chains, counterweights): parabolas a recording, (n, q)."""
    runs = np.unique(phases.run, return_inverse=True)[1]
    mine = (runs[:, None] == np.arange(runs.max() + 1)).astype(np.float64)
    away = phases.angle_rad[:, None] * mine
    away -= mine * (away.sum(axis=0) / mine.sum(axis=0))
    away /= max(float(np.abs(away).max()), 1.0)
    columns = np.hstack([mine[:, 1:], away, away**2])
    return np.asarray(columns - columns.mean(axis=0))


def observed_limits(recordings: Sequence[Sequence[FeatureBlock]]) -> SteadyLimits:
    """Limits of steady motion for an axis that moves as fast as in these recordings.

    Its fastest speed and its strongest acceleration are those of whole intervals, so that no
    noise of the encoder passes for them.
    """
    usable = [block for blocks in recordings for block in blocks if block.usable]
    if not usable:
        return SteadyLimits()
    moved = [(each.angle_end_rad - each.angle_start_rad) / each.duration_s for each in usable]
    gained = [(each.speed_end_rad_s - each.speed_start_rad_s) / each.duration_s for each in usable]
    fastest, strongest = (float(np.quantile(np.abs(each), 0.99)) for each in (moved, gained))
    return SteadyLimits().for_motion(fastest, strongest)


def require_motion(phases: SteadyPhases, limits: SteadyLimits) -> None:
    """Require moves both ways, at several speeds and with accelerations.

    Raises:
        CommissioningError: there are not; the text names the motion.
    """
    motion_s = float(phases.steady_s.sum()) if len(phases) else 0.0
    if motion_s < 3.0:
        raise CommissioningError(
            f"only {motion_s:.1f} s of steady motion: needs moves in both directions, "
            "such as `edge-service motion production`"
        )
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        if phases.steady_s[phases.direction == sign].sum() < 1.0:
            raise CommissioningError(f"no motion in {name} direction: needs moves in both")
    speeds = np.abs(phases.speed_rad_s)
    if np.quantile(speeds, 0.95) < 2.0 * np.quantile(speeds, 0.05):
        raise CommissioningError(
            "one speed only: dry and viscous friction cannot be told apart; needs moves at "
            "several speeds, such as `edge-service motion friction`"
        )
    if phases.steady_s[np.abs(phases.acceleration_rad_s2) > limits.cruise_rad_s2].sum() < 0.3:
        raise CommissioningError(
            "no accelerations: inertia and stiffness cannot be determined; needs "
            "`edge-service motion acceleration` or production moves"
        )
