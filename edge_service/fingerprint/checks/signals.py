"""Check that something is measured: a channel that never changes is switched off or stuck."""

from collections.abc import Sequence

import numpy as np

from ...messages.channels import ANGLE, CHANNELS, SETPOINT, TABLE_POSITION, TORQUE
from ...messages.samples import SampleFrame
from ...models.machine import Machine
from .check_result import CheckResult, Verdict

_MEASURED = (TORQUE, ANGLE, TABLE_POSITION)
LEAST_S = 1.0
"""Shorter recordings may well repeat a value, and show no motion to be judged."""


def check_signals(_machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Find channels without values, and those that keep one value to the last bit.

    A drive that holds an axis at rest still measures noise in its torque or its position.

    Raises:
        ValueError: too short to tell.
    """
    if sum(float(np.ptp(frame.time_s)) for frame in recordings if len(frame)) < LEAST_S:
        raise ValueError(f"less than {LEAST_S:g} s")
    there = [name for name in CHANNELS if any(name in frame.channels for frame in recordings)]
    empty = [name for name in there if not _values(recordings, name).size]
    still = [name for name in there if _is_still(recordings, name)]
    moving = [name for name in (ANGLE, TABLE_POSITION, SETPOINT) if name in {*there} - {*still}]
    measured = [name for name in _MEASURED if name in there]
    if measured and set(measured) <= {*still, *empty}:
        said = f"{', '.join(measured)}: not one value changes: the device is off, or not connected"
        return CheckResult("signals", Verdict.DOUBTFUL, said, forbids=True)
    if TORQUE in {*still, *empty} and moving:
        what = "has no value" if TORQUE in empty else "does not change"
        said = f"{TORQUE} {what} while the axis moves"
        return CheckResult("signals", Verdict.DOUBTFUL, said, forbids=True)
    stuck = [name for name in measured if name in {*still, *empty}]
    if stuck and moving:
        said = f"{', '.join(stuck)}: not one value changes while the axis moves"
        return CheckResult("signals", Verdict.DOUBTFUL, said)
    return CheckResult("signals", Verdict.FITS, "what is measured changes")


def _values(recordings: Sequence[SampleFrame], name: str) -> np.ndarray:
    held = [frame.channels[name] for frame in recordings if name in frame.channels]
    values = np.concatenate(held)
    return values[np.isfinite(values)]


def _is_still(recordings: Sequence[SampleFrame], name: str) -> bool:
    values = _values(recordings, name)
    return bool(values.size) and bool(np.ptp(values) == 0.0)
