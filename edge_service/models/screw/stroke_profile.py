"""Preload and series stiffness along the stroke of a commissioned axis."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.estimate import PreloadEstimate
from ...messages.samples import Floats
from ...messages.trend import Stroke, StrokeBand
from ..commissioned import TransmissionConfig
from ..machine import Machine
from .nut_law import LEAST_NUT_LOAD_PERCENT

PLACES = 41
_SIGMAS = 1.96
_Band = tuple[Floats, Floats, Floats]


@dataclass(frozen=True, slots=True, eq=False)
class StrokeProfile:
    """One axis along its stroke, for any mean preload."""

    position_m: Floats  # places of the table, (n,)
    fresh_percent: float  # mean preload when it was commissioned, of the load rating
    preload_share: Floats  # preload at a place over its mean, (n,)
    compliance_m_per_n: Floats  # of all in series at that preload, (n,); NaN where not learned
    compliance_tolerance: float  # its relative standard deviation
    nut_m_per_n: float  # the nut's own part of it
    nut_sigma_m_per_n: float

    @property
    def knows_stiffness(self) -> bool:
        """Return whether commissioning saw the stretch between two encoders."""
        return bool(np.isfinite(self.compliance_m_per_n).all())

    def told(self, estimate: PreloadEstimate) -> Stroke:
        """Profiles that an estimate implies, beside the commissioned ones."""
        knows = self.knows_stiffness
        return Stroke(
            position_m=_rounded(self.position_m),
            level=estimate.level,
            preload_percent=self._band(self.preload, estimate),
            stiffness_n_per_m=self._band(self.stiffness, estimate) if knows else None,
        )

    def _band(
        self, along: Callable[[float, float, float], _Band], estimate: PreloadEstimate
    ) -> StrokeBand:
        fresh, percent = self.fresh_percent, estimate.preload_percent
        commissioned = _rounded(along(fresh, fresh, fresh)[0])
        if percent is None:
            return StrokeBand(commissioned=commissioned)
        bounds = (estimate.low or 0.0, estimate.high or percent)
        value, low, high = map(_rounded, along(percent, *bounds))
        return StrokeBand(commissioned=commissioned, value=value, low=low, high=high)

    def preload(self, percent: float, low: float, high: float) -> _Band:
        """Preload at every place for a mean preload with its bounds, percent, (n,) each."""
        share = self.preload_share
        return percent * share, low * share, high * share

    def stiffness(self, percent: float, low: float, high: float) -> _Band:
        """Series stiffness at every place with its 95 % bounds, N/m, (n,) each.

        1/k = C(x) + C_n ((F_0 / F)^(1/3) - 1): the nut alone depends on the preload (5.3.2,
        5.3.11). The bounds hold those of the preload, of C and of the nut's share C_n.
        """
        softer = self._softening(percent)
        value = self.compliance_m_per_n + self.nut_m_per_n * softer
        spread = 0.5 * self.nut_m_per_n * (self._softening(low) - self._softening(high))
        error = np.sqrt(
            spread**2
            + (_SIGMAS * self.nut_sigma_m_per_n * softer) ** 2
            + (_SIGMAS * self.compliance_tolerance * self.compliance_m_per_n) ** 2
        )
        stiffest = np.maximum(value - error, 0.1 * value)
        return 1.0 / value, 1.0 / (value + error), 1.0 / stiffest

    def _softening(self, percent: float) -> Floats:
        local = np.maximum(percent * self.preload_share, LEAST_NUT_LOAD_PERCENT)
        return np.asarray(np.cbrt(self.fresh_percent / local) - 1.0)


def _rounded(values: Floats) -> tuple[float, ...]:
    return tuple(float(f"{value:.5g}") for value in values)


def stroke_profile(machine: Machine, places: int = PLACES) -> StrokeProfile | None:
    """Profile along the stroke, as commissioned; None where the machine file has none."""
    known, fresh = machine.commissioned, machine.fresh_preload_percent
    if known is None or fresh is None or machine.axis.stroke_m is None:
        return None
    position_m = np.linspace(0.0, machine.axis.stroke_m, places)
    share = preload_share(known.stroke_map, position_m / machine.axis.stroke_m)
    series = _series(machine, known.transmission, position_m)
    return StrokeProfile(position_m, fresh, share, *series)


def preload_share(harmonics: Iterable[Sequence[float]] | Floats, place: Floats) -> Floats:
    """Preload over its mean: 1 plus the harmonics of the stroke; `place` is from 0 to 1."""
    share = np.ones_like(place)
    for order, (cosine, sine) in enumerate(harmonics, start=1):
        phase = 2.0 * np.pi * order * place
        share += cosine * np.cos(phase) + sine * np.sin(phase)
    return np.maximum(share, 0.0)


def _series(
    machine: Machine, known: TransmissionConfig | None, position_m: Floats
) -> tuple[Floats, float, float, float]:
    """Compliance along the stroke with its tolerance; the nut's with its standard deviation."""
    mass = machine.model.table_mass_kg
    if known is None or mass is None:
        return np.full_like(position_m, np.nan), 0.0, 0.0, 0.0
    at_reference, away_m = known.stretch_per_acceleration_s2, position_m - known.reference_m
    stretch = at_reference + known.stretch_slope_s2_per_m * away_m
    stretch += known.stretch_bow_s2_per_m2 * away_m**2
    compliance = np.maximum(stretch, 0.1 * at_reference) / mass.value
    tolerance = float(np.hypot(known.stretch_sigma_s2 / at_reference, mass.tolerance))
    nut = at_reference / mass.value
    return compliance, tolerance, known.nut_share * nut, known.nut_share_sigma * nut
