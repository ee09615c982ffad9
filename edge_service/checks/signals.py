"""Checks that what matters is read, and that something is measured in it."""

import re
from collections.abc import Sequence
from collections.abc import Set as AbstractSet

import numpy as np

from ..messages.channels import ANGLE, CHANNELS, SETPOINT, TABLE_POSITION, TORQUE
from ..messages.features import FAULT_WORDS, Fault
from ..messages.samples import SampleFrame
from ..models.machine import Machine
from .finding import Finding, Verdict

_STUCK = {
    TORQUE: Fault.TORQUE_STUCK,
    ANGLE: Fault.ANGLE_STUCK,
    TABLE_POSITION: Fault.TABLE_STUCK,
}
LEAST_S = 1.0
"""Shorter recordings may well repeat a value, and show no motion to be judged."""
_TORQUE = re.compile(
    r"torque|trq|moment|current|curr\b|curr[^e]|strom|load|last|force|kraft"
    r"|(?<![a-z])n ?\*?m(?![a-z])|(?<![a-z])m?a(?![a-z])|(?<![a-z])i_?q",
    re.IGNORECASE,
)
"""Words and units of a motor's torque or current, in English and German."""
_SHOWN = 8


def check_columns(channels: AbstractSet[str], unread: Sequence[str]) -> Finding:
    """Find a torque that is missing, and the column that may hold it."""
    compared = "headers of the columns against the known channels"
    named = [name for name in unread if name]
    likely = [name for name in named if _TORQUE.search(name)]
    if TORQUE in channels:
        sentence = "torque and position are read" if channels & {ANGLE, TABLE_POSITION} else ""
        sentence = sentence or f"neither {ANGLE} nor {TABLE_POSITION} is read"
        fits = Verdict.FITS if channels & {ANGLE, TABLE_POSITION} else Verdict.DOUBTFUL
        return Finding("columns", fits, sentence, compared=compared)
    if likely:
        sentence = f"no column is read as {TORQUE}, though there is {_listed(likely)}"
        remedy = f"add columns.{TORQUE} = {{ column = {likely[0]!r}, scale = ... }}"
    else:
        sentence = f"no column is read as {TORQUE}"
        sentence += f"; not read: {_listed(named)}" if named else ""
        remedy = f"name the column of the torque or current in columns.{TORQUE}"
    return Finding(
        "columns",
        Verdict.DOUBTFUL,
        sentence,
        compared=compared,
        remedy=remedy,
        forbids=bool(likely),
    )


def _listed(names: Sequence[str]) -> str:
    more = ", ..." if len(names) > _SHOWN else ""
    return ", ".join(repr(name) for name in names[:_SHOWN]) + more


def check_signals(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
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
    measured = [name for name in _STUCK if name in there]
    if measured and set(measured) <= {*still, *empty}:
        said = f"{', '.join(measured)}: not one value changes: the device is off, or not connected"
        return Finding("signals", Verdict.DOUBTFUL, said, forbids=True)
    if TORQUE in {*still, *empty} and moving:
        fault = Fault.NO_TORQUE if TORQUE in empty else Fault.TORQUE_STUCK
        said = f"{TORQUE}: {FAULT_WORDS[fault]}"
        return Finding("signals", Verdict.DOUBTFUL, said, forbids=True)
    stuck = [name for name in measured if name in {*still, *empty}]
    if stuck and moving:
        said = "; ".join(f"{name}: {FAULT_WORDS[_STUCK[name]]}" for name in stuck)
        return Finding("signals", Verdict.DOUBTFUL, said)
    return Finding("signals", Verdict.FITS, "what is measured changes")


def _values(recordings: Sequence[SampleFrame], name: str) -> np.ndarray:
    held = [frame.channels[name] for frame in recordings if name in frame.channels]
    values = np.concatenate(held)
    return values[np.isfinite(values)]


def _is_still(recordings: Sequence[SampleFrame], name: str) -> bool:
    values = _values(recordings, name)
    return bool(values.size) and bool(np.ptp(values) == 0.0)
