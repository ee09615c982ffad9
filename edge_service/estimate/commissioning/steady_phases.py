"""Phases of steady motion of several recordings, as the columns of a regression."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from ...messages.features import FeatureBlock, Phase
from ...messages.samples import Floats
from ...models.steady_limits import SteadyLimits
from ..effect_compensation import EffectCompensation


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

        def compensated(phase: Phase, block: FeatureBlock) -> Phase:
            if known is None:
                return phase
            return known.compensated(phase, block.steady_direction, block.time_s)

        rows = [
            (
                run,
                block.time_s,
                phase.steady_s,
                block.steady_direction,
                *_numbers(compensated(phase, block)),
            )
            for run, blocks in enumerate(recordings)
            for block in blocks
            if block.usable
            for phase in block.phases
        ]
        table = np.array(rows, dtype=np.float64).reshape(-1, 9)
        return cls(*table.T)

    def where(self, chosen: npt.NDArray[np.bool_]) -> "SteadyPhases":
        """Rows by mask, chosen (n,) bool."""
        return self.at(np.flatnonzero(chosen))

    def at(self, places: npt.NDArray[np.intp]) -> "SteadyPhases":
        """Rows by index, places (m,)."""
        return SteadyPhases(*(getattr(self, field.name)[places] for field in fields(self)))

    def __len__(self) -> int:
        return len(self.time_s)


def _numbers(phase: Phase) -> tuple[float, ...]:
    return (
        phase.torque_nm,
        phase.acceleration_rad_s2,
        phase.speed_rad_s,
        phase.angle_rad,
        phase.table_m,
    )


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
    _require_both_ways(phases)
    speeds = np.abs(phases.speed_rad_s)
    if np.quantile(speeds, 0.95) < 2.0 * np.quantile(speeds, 0.05):
        raise CommissioningError(
            "one speed only: dry and viscous friction cannot be told apart; needs moves at "
            "several speeds, such as `edge-service motion friction`"
        )
    driven = np.abs(phases.acceleration_rad_s2) > limits.cruise_rad_s2
    if phases.steady_s[driven].sum() < 0.3:
        raise CommissioningError(
            "no accelerations: inertia and stiffness cannot be determined; needs "
            "`edge-service motion acceleration` or production moves"
        )


def _require_both_ways(phases: SteadyPhases) -> None:
    motion_s = float(phases.steady_s.sum()) if len(phases) else 0.0
    if motion_s < 3.0:
        raise CommissioningError(
            f"only {motion_s:.1f} s of steady motion: needs moves in both directions, "
            "such as `edge-service motion production`"
        )
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        if phases.steady_s[phases.direction == sign].sum() < 1.0:
            raise CommissioningError(
                f"no motion in {name} direction: needs moves in both directions"
            )
