"""Noise of a session: what no fit can explain, and how much of a residual matters."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from ..residual.noise_floor import Floor, noise_floor
from ..session.session import Session
from ..session.tolerance import stated_tolerance

MOST_EFFECTIVE = 400.0
"""Independent observations that a channel counts for at most: the library is an approximation."""
_LEAST_EFFECTIVE = 40.0
DISCREPANCY = 0.05
"""Share of the gap that the best entry may still miss on a real axis."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Noise that a fit cannot explain, by channel.

    Attributes:
        floor: root mean square that a healthy axis leaves.
        tolerance: root mean square that nobody needs to know the cause of.
        effective: independent observations among the rows; bounded, because the library is no
            better than an approximation of a real axis.
        discrepancy: root mean square below which one fit is no better than another.
    """

    floor: Mapping[str, float]
    tolerance: Mapping[str, float]
    effective: Mapping[str, float]
    discrepancy: Mapping[str, float]

    def beyond(self, channel: str, rms: float) -> float:
        """Part of a root mean square that is not the floor's."""
        return math.sqrt(max(rms**2 - self.floor[channel] ** 2, 0.0))

    def matters(self, channel: str, rms: float) -> bool:
        """Tell whether a root mean square exceeds the floor by more than the tolerance."""
        return self.beyond(channel, rms) > self.tolerance[channel]

    def variance(self, channel: str, rms: float) -> float:
        """Variance of an observation by a fit that leaves a root mean square."""
        return rms**2 + self.discrepancy[channel] ** 2

    def unexplained_shares(
        self, session: Session, left_rms: Mapping[str, float]
    ) -> dict[str, float]:
        """Share of each channel's energy above the floor that is left, `left_rms` by channel.

        A remainder within the tolerance counts as none.
        """
        found = {}
        for name, rows in session.channels.items():
            above, left = self.beyond(name, rows.rms), left_rms[name]
            counts = above > 0.0 and self.matters(name, left)
            found[name] = min((self.beyond(name, left) / above) ** 2, 1.0) if counts else 0.0
        return found


def noise_of_gap(session: Session, machine: Machine) -> Noise:
    """Noise as the gap itself shows it, before anything is fitted."""
    gaps = {name: rows.gap for name, rows in session.channels.items()}
    floor = _above_healthy(session, noise_floor(session, gaps))
    return Noise(
        floor=floor,
        tolerance=stated_tolerance(machine, floor, session.torque_rms_nm),
        effective=dict.fromkeys(session.channels, MOST_EFFECTIVE),
        discrepancy={name: DISCREPANCY * rows.rms for name, rows in session.channels.items()},
    )


def noise_of_residual(
    session: Session, machine: Machine, noise: Noise, left: Mapping[str, Floats]
) -> Noise:
    """Noise as the residual of a fit shows it: independent observations, and a lower floor.

    Args:
        left: residual by channel, (n,).
    """
    again = noise_floor(session, left)
    effective = {
        name: float(np.clip(each.independent, _LEAST_EFFECTIVE, MOST_EFFECTIVE))
        for name, each in again.items()
    }
    bounded = _above_healthy(session, again)
    floor = {name: min(bounded[name], rms) for name, rms in noise.floor.items()}
    tolerance = stated_tolerance(machine, floor, session.torque_rms_nm)
    return replace(noise, effective=effective, floor=floor, tolerance=tolerance)


def _above_healthy(session: Session, floor: Mapping[str, Floor]) -> dict[str, float]:
    """Floor, at least that by which healthy recordings part from one another."""
    healthy = {} if session.healthy is None else session.healthy.floor
    return {name: max(each.rms, healthy.get(name, 0.0)) for name, each in floor.items()}
