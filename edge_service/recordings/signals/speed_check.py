"""Check that a recorded speed is the derivative of its position: units do not lie about that."""

import math
from dataclasses import dataclass

import numpy as np

from ...messages.channels import ANGLE, MOTOR_SPEED, TABLE_POSITION, TABLE_SPEED
from ...messages.samples import SampleFrame

PAIRS = ((ANGLE, MOTOR_SPEED), (TABLE_POSITION, TABLE_SPEED))
_WINDOW_ROWS = 16
_TOLERANCE = 1.25
_ENOUGH_R_SQUARED = 0.5
_REASONS = (
    (60.0, "recorded per second, not per minute"),
    (1.0 / 60.0, "recorded per minute, not per second"),
    (360.0, "a rotary axis, in degrees and rev/min"),
    (-1.0, "opposite signs"),
)


@dataclass(slots=True)
class _Sums:
    """Sums over changes of position d and integrals of speed s over windows: d d, d s, s s."""

    dd: float = 0.0
    ds: float = 0.0
    ss: float = 0.0


class SpeedCheck:
    """Regression of position changes on integrated speeds, over all rows seen."""

    def __init__(self) -> None:
        self._sums = {pair: _Sums() for pair in PAIRS}

    def add(self, frame: SampleFrame) -> None:
        """The rows of a frame, in windows of a few rows; windows over gaps are left out."""
        rows = (len(frame) - 1) // _WINDOW_ROWS * _WINDOW_ROWS
        if rows <= 0:
            return
        step_s = np.diff(frame.time_s[: rows + 1])
        usable = (step_s > 0.0) & (step_s < _TOLERANCE * np.median(step_s))
        step_s = np.where(usable, step_s, np.nan).reshape(-1, _WINDOW_ROWS)
        for (position, speed), sums in self._sums.items():
            if position not in frame.channels or speed not in frame.channels:
                continue
            values = frame.channels[position][: rows + 1 : _WINDOW_ROWS]
            speeds = frame.channels[speed][: rows + 1]
            mean = 0.5 * (speeds[1:] + speeds[:-1]).reshape(-1, _WINDOW_ROWS)
            change, integral = np.diff(values), (mean * step_s).sum(axis=1)
            good = np.isfinite(change) & np.isfinite(integral)
            sums.dd += float(change[good] @ change[good])
            sums.ds += float(change[good] @ integral[good])
            sums.ss += float(integral[good] @ integral[good])

    def remarks(self) -> list[str]:
        """One line for each speed that moves with its position, but not as its derivative."""
        lines = []
        for (position, speed), sums in self._sums.items():
            scatter = sums.dd * sums.ss
            if scatter == 0.0 or sums.ds**2 < _ENOUGH_R_SQUARED * scatter:
                continue
            factor = sums.ds / sums.ss
            if not 1.0 / _TOLERANCE < factor < _TOLERANCE:
                lines.append(
                    f"{speed} would have to be {factor:.3g} times as large to be the derivative of "
                    f"{position}{_reason(factor)}; check their scales under [columns]"
                )
        return lines


def _reason(factor: float) -> str:
    for value, reason in _REASONS:
        if factor / value > 0.0 and abs(math.log(factor / value)) < math.log(_TOLERANCE):
            return f" ({reason}?)"
    return ""
