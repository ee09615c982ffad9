"""Coulomb drag of an axis from the torque balance of intervals, with its uncertainty.

A Kalman filter on [drag, offset, viscous, asymmetry, inertia] with the exact balance of an interval
(integral of thesis eq. 4.3.4)::

    mean(u) = drag mean(sgn w) + offset + viscous mean(w) + asymmetry |mean(w)|
              + inertia (w_end - w_start) / T + noise

Asymmetry is viscous friction that differs with the direction, as on real axes. Drag wanders (random
walk); the others are constants with the prior of the machine file. Noise is learned from the
innovations, so an axis whose friction departs from the model gets a wider interval.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...messages.features import FeatureBlock
from ...messages.stored import Number, Stored, StoredFloats
from ...models.machine import Machine

_STATES = 5
_DRAG = 0
WANDER_PER_SQRT_S = 0.02
"""Random walk of the drag, as a share of the greatest drag seen, 1/sqrt(s)."""
VISCOUS_TOLERANCE = 0.10
"""Least relative prior sigma of viscous friction: it falls with warm-up."""
ASYMMETRY_SHARE, OFFSET_SHARE = 0.2, 0.3
"""Prior sigmas: of the asymmetry over the viscous friction, of the offset over the friction."""
VISCOUS_FLOOR_SHARE = 0.5
"""Of the first friction torque seen: as much is thought to be viscous, whatever the file states."""
NOISE_MEMORY = 50.0  # intervals over which the noise is learned
WANDER_ADAPTION, HASTE_BOUNDS = 0.03, (0.3, 30.0)
"""Step, in logs, of the wander's factor per interval, and its bounds."""
CORRELATION = 4.0
"""Variance of a mean over many intervals over that of white noise: friction errs for longer."""
SURPRISE_NIS, SURPRISES_OF_A_JUMP = 16.0, 3


@dataclass(slots=True)
class _State:
    """Everything on which the next update depends; see DragFilter."""

    state: StoredFloats
    covariance: StoredFloats
    noise_var: float = 0.0
    greatest_nm: float = 0.0
    last_innovation: float = 0.0
    haste: float = 1.0
    surprises: int = 0
    count: int = 0
    nis: Number = float("nan")


_STORED: Stored[_State] = Stored(_State)


class DragFilter:
    """Drag torque and its standard deviation from informative intervals.

    Args:
        machine: gives inertia and viscous friction with their tolerances.
    """

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        model = self._machine.model
        mean = [0.0, 0.0, model.viscous_nm_s_per_rad.value, 0.0, model.inertia_kg_m2.value]
        self._now = _State(np.array(mean), np.zeros((_STATES, _STATES)))

    def update(self, block: FeatureBlock, elapsed_s: float) -> None:
        """Take an informative interval, `elapsed_s` after the one before."""
        now, duration = self._now, block.duration_s
        speed = (block.angle_end_rad - block.angle_start_rad) / duration
        acceleration = (block.speed_end_rad_s - block.speed_start_rad_s) / duration
        regressor = np.array([block.direction_mean, 1.0, speed, abs(speed), acceleration])
        known = float(regressor[2:] @ now.state[2:])
        if now.count == 0:
            self._begin(block.torque_mean_nm - known, abs(speed))
        now.greatest_nm = max(now.greatest_nm, abs(self.drag_nm))
        wander_nm = now.haste * WANDER_PER_SQRT_S * now.greatest_nm
        now.covariance[_DRAG, _DRAG] += wander_nm**2 * elapsed_s
        self._correct(regressor, block.torque_mean_nm - float(regressor @ now.state))
        now.count += 1

    def _begin(self, friction_nm: float, speed: float) -> None:
        model, scale = self._machine.model, max(abs(friction_nm), 1e-9)
        viscous = model.viscous_nm_s_per_rad
        floor = max(viscous.value, VISCOUS_FLOOR_SHARE * scale / max(speed, 1.0))
        frictions = [max(viscous.sigma, VISCOUS_TOLERANCE * floor), ASYMMETRY_SHARE * floor]
        levels = [10.0 * scale, OFFSET_SHARE * scale]
        sigma = np.array([*levels, *frictions, model.inertia_kg_m2.sigma])
        self._now.covariance = np.diag(sigma**2)
        self._now.noise_var = (0.2 * scale) ** 2

    def _correct(self, regressor: np.ndarray[Any, Any], innovation: float) -> None:
        now = self._now
        projected = now.covariance @ regressor
        predicted_var = float(regressor @ projected)
        innovation_var = predicted_var + CORRELATION * now.noise_var
        now.nis = innovation**2 / (predicted_var + now.noise_var)
        now.surprises = now.surprises + 1 if now.nis > SURPRISE_NIS else 0
        if now.surprises >= SURPRISES_OF_A_JUMP:  # believe the new level, keep the constants
            now.covariance[_DRAG, _DRAG] += innovation**2
            now.surprises = 0
            self._correct(regressor, innovation)
            return
        if now.surprises:  # perhaps an outlier: it must not move the constants
            return
        gain = projected / innovation_var
        now.state = now.state + gain * innovation
        reduced = np.eye(_STATES) - np.outer(gain, regressor)
        noise = CORRELATION * now.noise_var
        now.covariance = reduced @ now.covariance @ reduced.T + np.outer(gain, gain) * noise
        self._learn(innovation)

    def _learn(self, innovation: float) -> None:
        """Noise from the differences of successive innovations, wander from their products.

        A difference holds twice the noise whatever the drag does slowly; a positive product says
        that the drag runs away from the filter (Mehra 1970), which then follows faster.
        """
        now = self._now
        if now.count > _STATES:
            share = 1.0 / min(now.count - _STATES + 2.0, NOISE_MEMORY)
            seen = 0.5 * (innovation - now.last_innovation) ** 2
            now.noise_var += share * (seen - now.noise_var)
            lag = innovation * now.last_innovation / max(now.noise_var, 1e-300)
            rate, (least, most) = min(max(lag, -1.0), 1.0) * WANDER_ADAPTION, HASTE_BOUNDS
            now.haste = min(max(float(now.haste * np.exp(rate)), least), most)
        now.last_innovation = innovation

    @property
    def nis(self) -> float:
        """Normalised innovation squared of the last interval; NaN before the first."""
        return self._now.nis

    @property
    def drag_nm(self) -> float:
        """Coulomb torque at the motor shaft, N m."""
        return float(self._now.state[_DRAG])

    @property
    def sigma_nm(self) -> float:
        """Its standard deviation, N m."""
        return float(np.sqrt(self._now.covariance[_DRAG, _DRAG]))

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values."""
        return dict(_STORED.dump(self._now))

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        self._now = _STORED.load(snapshot)
