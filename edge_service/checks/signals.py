"""Checks of channels by themselves: read, measured, and within what an axis can reach."""

import re
from collections.abc import Sequence
from collections.abc import Set as AbstractSet

import numpy as np

from ..messages.features import FAULT_WORDS, Fault
from ..messages.samples import (
    ANGLE,
    CHANNELS,
    SETPOINT,
    TABLE_POSITION,
    TEMPERATURE,
    TORQUE,
    Floats,
    SampleFrame,
)
from ..models.machine import Machine
from .finding import Finding, Verdict
from .sampling import motion_speeds

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
STROKE_SLACK = 0.02
LIMIT_SLACK = 1.5
"""Drives overshoot their speed by tenths, and motors give half more than rated for a moment."""
TEMPERATURES_C = (-40.0, 150.0)


def check_columns(channels: AbstractSet[str], unread: Sequence[str]) -> Finding:
    """Find a torque that is missing, and the column that may hold it."""
    compared = "headers of the columns against the known channels"

    def listed(names: Sequence[str]) -> str:
        more = ", ..." if len(names) > _SHOWN else ""
        return ", ".join(repr(name) for name in names[:_SHOWN]) + more

    named = [name for name in unread if name]
    likely = [name for name in named if _TORQUE.search(name)]
    if TORQUE in channels:
        sentence = "torque and position are read" if channels & {ANGLE, TABLE_POSITION} else ""
        sentence = sentence or f"neither {ANGLE} nor {TABLE_POSITION} is read"
        fits = Verdict.FITS if channels & {ANGLE, TABLE_POSITION} else Verdict.DOUBTFUL
        return Finding("columns", fits, sentence, compared=compared)
    if likely:
        sentence = f"no column is read as {TORQUE}, though there is {listed(likely)}"
        remedy = f"add columns.{TORQUE} = {{ column = {likely[0]!r}, scale = ... }}"
    else:
        sentence = f"no column is read as {TORQUE}"
        sentence += f"; not read: {listed(named)}" if named else ""
        remedy = f"name the column of the torque or current in columns.{TORQUE}"
    return Finding(
        "columns",
        Verdict.DOUBTFUL,
        sentence,
        compared=compared,
        remedy=remedy,
        forbids=bool(likely),
    )


def check_signals(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Find channels without values, and those that keep one value to the last bit.

    A drive that holds an axis at rest still measures noise in its torque or its position.
    Raises ValueError: too short to tell.
    """
    if sum(float(np.ptp(frame.time_s)) for frame in recordings if len(frame)) < LEAST_S:
        raise ValueError(f"less than {LEAST_S:g} s")
    there = [name for name in CHANNELS if any(name in frame.channels for frame in recordings)]
    empty = [name for name in there if not _values(recordings, name).size]
    spans = {name: np.ptp(_values(recordings, name)) for name in there if name not in empty}
    still = [name for name, span in spans.items() if span == 0.0]
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


def check_stroke(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Hold the table's range against the stroke."""
    stroke = machine.axis.stroke_m
    if stroke is None:
        return Finding("stroke", Verdict.UNKNOWN, "cannot tell: axis.stroke_m is missing")
    low, high = _range(recordings, TABLE_POSITION)
    sentence = f"table moves from {low:.4g} to {high:.4g} m of a stroke of {stroke:g} m"
    slack = STROKE_SLACK * stroke
    inside = -slack <= low and high <= stroke + slack
    return Finding("stroke", Verdict.FITS if inside else Verdict.DOUBTFUL, sentence)


def check_temperature(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Hold the temperature against what a machine can have."""
    low, high = _range(recordings, TEMPERATURE)
    inside = TEMPERATURES_C[0] <= low and high <= TEMPERATURES_C[1]
    sentence = f"temperature from {low:.3g} to {high:.3g} degC"
    return Finding("temperature", Verdict.FITS if inside else Verdict.DOUBTFUL, sentence)


def check_limits(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Hold the greatest speed and torque against the axis' stated limits."""
    said, exceeded = [], False
    for what, unit, limit, values in (
        ("speed", "rad/s", machine.axis.max_speed_rad_s, motion_speeds(machine, recordings)),
        ("torque", "N m", machine.axis.max_torque_nm, _values(recordings, TORQUE)),
    ):
        if limit is not None and len(values):
            greatest = float(np.quantile(np.abs(values), 0.99))
            exceeded |= greatest > LIMIT_SLACK * limit
            said.append(f"{what} up to {greatest:.3g} {unit} of {limit:.3g}")
    if not said:
        raise ValueError(f"neither {TORQUE} nor {ANGLE}")
    return Finding("limits", Verdict.DOUBTFUL if exceeded else Verdict.FITS, "; ".join(said))


def _values(recordings: Sequence[SampleFrame], channel: str) -> Floats:
    """Values of all recordings that are known, (n,)."""
    held = [frame.channels[channel] for frame in recordings if channel in frame.channels]
    values: Floats = np.concatenate([*held, np.empty(0)])
    return values[np.isfinite(values)]


def _range(recordings: Sequence[SampleFrame], channel: str) -> tuple[float, float]:
    known = _values(recordings, channel)
    if known.size == 0:
        raise ValueError(f"{channel} in {CHANNELS[channel].unit} has no value")
    return float(known.min()), float(known.max())
