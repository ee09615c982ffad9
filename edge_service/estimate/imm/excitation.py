"""Excitation: criteria for intervals that carry information on friction."""

from dataclasses import dataclass

from ...messages.features import FeatureBlock


@dataclass(frozen=True, slots=True)
class ExcitationSettings:
    """Criteria for motion that carries information on drag.

    Attributes:
        reversal_gate_s: time after a reversal or a start that is left out (presliding, wind-up).
        min_speed_rad_s: slower motion is left out (Stribeck regime, creeping jogs).
        hold_s: a number may stand for this long without informative motion.
    """

    reversal_gate_s: float = 0.1
    min_speed_rad_s: float = 0.3
    hold_s: float = 10.0


def informative(block: FeatureBlock, settings: ExcitationSettings) -> bool:
    """True if the interval is good data of steady motion in one direction."""
    if not block.usable or abs(block.direction_mean) < 0.999:
        return False
    if block.since_reversal_s < settings.reversal_gate_s:
        return False
    travel_rad = abs(block.angle_end_rad - block.angle_start_rad)
    return travel_rad >= settings.min_speed_rad_s * block.duration_s
