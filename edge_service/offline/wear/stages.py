"""Wear test of a ball screw: its drag torque after every stage, and how far it had run by then."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...messages.samples import Floats
from ...recordings.columns import TraceError

LEAD_M = 0.008
_MIN_PER_H = 60.0


@dataclass(frozen=True, slots=True)
class Schedule:
    """Speed of the test: constant, or raised by a step again and again.

    Attributes:
        stage_h: time between two readings, h.
        speed_rpm: at first, rev/min.
        speed_step_rpm: so much more after every `speed_step_h`, rev/min.
    """

    stage_h: float = 35.0
    speed_rpm: float = 300.0
    speed_step_rpm: float = 200.0
    speed_step_h: float = 140.0

    def revolutions(self, time_h: Floats) -> Floats:
        """Revolutions run until each time, (n,)."""
        steps = np.floor(time_h / self.speed_step_h)
        at_step_h = steps * self.speed_step_h
        before_h = self.speed_step_h * steps * (steps - 1.0) / 2.0 * self.speed_step_rpm
        whole = at_step_h * self.speed_rpm + before_h
        speed_rpm = self.speed_rpm + steps * self.speed_step_rpm
        return np.asarray(_MIN_PER_H * (whole + (time_h - at_step_h) * speed_rpm))


@dataclass(frozen=True, slots=True, eq=False)
class WearTest:
    """Readings of one screw; the first is that of the fresh screw.

    Attributes:
        time_h, distance_m: time and way run until each reading, (n,).
        drag_nm: mean drag torque, N m, (n,).
    """

    time_h: Floats
    distance_m: Floats
    drag_nm: Floats

    @property
    def percent(self) -> Floats:
        """Drag in percent of the fresh screw's, (n,)."""
        return np.asarray(100.0 * self.drag_nm / self.drag_nm[0])


def read_wear_test(path: Path, schedule: Schedule) -> WearTest:
    """Read a file of one drag torque a line, N m, from new. Raises TraceError."""
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise TraceError(f"{path}: {error}") from None
    numbered = [(number, line.strip()) for number, line in enumerate(lines, 1) if line.strip()]
    drag_nm = np.array([_positive(path, number, line) for number, line in numbered])
    if drag_nm.size < 2:
        raise TraceError(f"{path}: expected a drag torque in N m on each of at least 2 lines")
    time_h = schedule.stage_h * np.arange(drag_nm.size, dtype=np.float64)
    return WearTest(time_h, LEAD_M * schedule.revolutions(time_h), drag_nm)


def _positive(path: Path, number: int, line: str) -> float:
    try:
        value = float(line)
    except ValueError:
        value = 0.0
    if not 0.0 < value < np.inf:
        raise TraceError(f"{path}: line {number}: {line[:40]!r} is no drag torque in N m above 0")
    return value
