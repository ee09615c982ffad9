"""What a mixture of hypotheses says about the axis: values with intervals, and probabilities."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..messages.estimate import Interval
from ..messages.samples import Floats
from ..models.machine import Machine
from ..models.stiffness import LEAST_NUT_LOAD_PERCENT
from .fused_model import Start
from .fused_state import (
    DRY,
    GAIN,
    GUIDE,
    MASS,
    NUT,
    PLAY,
    PRELOAD,
    RATE,
    RUB_NODES,
    WEARING,
    FusedModel,
    Mixture,
)
from .mixture_interval import interval, mixture_cdf
from .transition import LEVELS_PERCENT

MODEL_ERROR_SHARE = 0.02
"""Error of the cube root law, as a share of the way from the fresh preload."""
MODEL_ERROR_PERCENT = 0.12
LAG_S = 1.5
"""A preload that runs at a rate is followed with about this delay, s of motion."""
LEAST_KNOWN_PERCENT = 1.5
"""Below this nothing tells a preload from none: a clearance may be there."""
LOST_SHARE, SLICK_SHARE, RUB_SHARE, PAYLOAD_SHARE, GAIN_SHARE = 0.1, 0.2, 0.1, 0.1, 0.05
PLAY_M = 1.5e-6
"""Changes since commissioning that count as faults: of preload, whole friction, whole friction,
table mass, torque constant; and of the play."""


@dataclass(frozen=True, slots=True)
class Answers:
    """The mixture of one axis, read; see PreloadEstimate for what each answer means."""

    mixture: Mixture
    model: FusedModel
    machine: Machine
    start: Start

    @property
    def _alive(self) -> slice:
        return slice(0, int(self.mixture.alive[0]))

    @property
    def _weight(self) -> Floats:
        weight = np.exp(self.mixture.log_weight[self._alive])
        return np.asarray(weight / weight.sum())

    def preload(self) -> tuple[float, float, float]:
        """Mean and 95 % interval, %."""
        weight, mean, sigma = self._marginal()
        percent = max(float(weight @ mean), 0.0)
        low, high = interval(weight, mean, sigma, LEAST_KNOWN_PERCENT)
        return percent, min(low, percent), max(high, percent)

    def _marginal(self) -> tuple[Floats, Floats, Floats]:
        """Weights, means and standard deviations of the preload, %, one per hypothesis."""
        mean = self.mixture.mean[self._alive]
        variance = np.maximum(self.mixture.covariance[self._alive, PRELOAD, PRELOAD], 0.0)
        away = mean[:, PRELOAD] - self.model.fresh_percent
        drag = self.machine.model.preload_drag_nm
        scale = MODEL_ERROR_SHARE if drag is None else max(MODEL_ERROR_SHARE, drag.tolerance)
        lag = LAG_S * mean[:, RATE] * (self.mixture.mode[self._alive] == WEARING)
        systematic = (scale * away) ** 2 + MODEL_ERROR_PERCENT**2 + lag**2
        return self._weight, mean[:, PRELOAD], np.sqrt(variance + systematic)

    def _along(self, slope: Floats) -> tuple[Floats, Floats]:
        """Mean and standard deviation of slope @ state, one per hypothesis."""
        covariance = self.mixture.covariance[self._alive]
        within = (covariance @ slope) @ slope
        return self.mixture.mean[self._alive] @ slope, np.sqrt(np.maximum(within, 1e-30))

    def _slope(self, entries: dict[int, float]) -> Floats:
        slope = np.zeros(self.mixture.mean.shape[1])
        for index, value in entries.items():
            slope[index] = value
        return slope

    def drag(self) -> Interval:
        """Coulomb torque of the whole axis, N m."""
        per_percent, ratio = self.model.drag_per_percent_nm, self.model.ratio_m_per_rad
        mean, sigma = self._along(self._slope({PRELOAD: per_percent, DRY: 1.0, GUIDE: ratio}))
        value = float(self._weight @ mean)
        half = 1.96 * float(np.sqrt(self._weight @ (sigma**2 + (mean - value) ** 2)))
        return Interval(value=value, low=value - half, high=value + half)

    def stiffness(self) -> Interval | None:
        """Series stiffness at `reference_m`, N/m (5.3.2, 5.3.11); None with one encoder.

        1/k = C + C_n ((F_0/F)^(1/3) - 1).
        """
        model, mass = self.model, self.machine.model.table_mass_kg
        if model.compliance_m_per_n == 0.0 or mass is None:
            return None
        weight, percent, sigma = self._marginal()
        nut = self.mixture.mean[self._alive, NUT]
        nut_variance = np.maximum(self.mixture.covariance[self._alive, NUT, NUT], 0.0)
        load = np.maximum(percent, LEAST_NUT_LOAD_PERCENT)
        root = np.cbrt(model.fresh_percent / load)
        compliance = model.compliance_m_per_n + nut * (root - 1.0)
        by_percent = np.where(percent > LEAST_NUT_LOAD_PERCENT, nut * root / (3.0 * load), 0.0)
        variance = (by_percent * sigma) ** 2 + (root - 1.0) ** 2 * nut_variance
        variance += (mass.tolerance * compliance) ** 2
        value = float(weight @ compliance)
        half = 1.96 * float(np.sqrt(weight @ (variance + (compliance - value) ** 2)))
        least = max(value - half, 0.1 * value)
        return Interval(value=1.0 / value, low=1.0 / (value + half), high=1.0 / least)

    def levels(self) -> dict[str, float]:
        """Probability that each of the seed's levels is the nearest."""
        levels = sorted(LEVELS_PERCENT)
        edges = [0.5 * (a + b) for a, b in pairwise(levels)]
        marginal = self._marginal()
        below = [0.0, *(mixture_cdf(edge, *marginal) for edge in edges), 1.0]
        share = dict(zip(levels, np.diff(below).tolist(), strict=True))
        return {f"{level:g}": share[level] for level in LEVELS_PERCENT}

    def faults(self) -> dict[str, float]:
        """Probability of each change since commissioning that this axis can show."""
        model = self.model
        taught = self.machine.commissioned
        assert taught is not None
        fresh, ratio = model.fresh_percent, model.ratio_m_per_rad
        rest = self._slope({DRY: 1.0, GUIDE: ratio})
        begun_nm = float(self.start.mean @ rest)
        found = {
            "preload_loss": mixture_cdf((1.0 - LOST_SHARE) * fresh, *self._marginal()),
            "lubrication": self._above(rest, begun_nm + SLICK_SHARE * taught.coulomb_nm),
            "torque_constant": self._beyond({GAIN: 1.0}, GAIN_SHARE),
            "process_force": float(self._weight @ self.mixture.force[self._alive]),
        }
        if taught.transmission is not None:
            found["payload"] = self._beyond({MASS: 1.0}, PAYLOAD_SHARE * model.table_mass_kg)
            found["backlash"] = self._above(self._slope({PLAY: 1.0}), PLAY_M)
            found["misalignment"] = self._rubbing(RUB_SHARE * taught.coulomb_nm / ratio)
        return {name: min(max(value, 0.0), 1.0) for name, value in found.items()}

    def _above(self, slope: Floats, limit: float) -> float:
        return 1.0 - mixture_cdf(limit, self._weight, *self._along(slope))

    def _beyond(self, entries: dict[int, float], limit: float) -> float:
        slope = self._slope(entries)
        return self._above(slope, limit) + self._above(-slope, limit)

    def _rubbing(self, limit_n: float) -> float:
        """Probability that the worst place rubs more than the mean of all by a limit."""
        size = self.mixture.mean.shape[1]
        if size < RUB_NODES:
            return 0.0
        mean = dict.fromkeys(range(size - RUB_NODES, size), -1.0 / RUB_NODES)
        places = range(size - RUB_NODES, size)
        return max(
            self._above(self._slope(mean | {i: 1.0 - 1.0 / RUB_NODES}), limit_n) for i in places
        )
