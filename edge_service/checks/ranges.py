"""Checks of ranges: what a channel reaches, against what the axis or a machine can."""

from collections.abc import Sequence

import numpy as np

from ..messages.channels import ANGLE, CHANNELS, TABLE_POSITION, TEMPERATURE, TORQUE
from ..messages.samples import Floats, SampleFrame
from ..models.machine import Machine
from .finding import Finding, Verdict
from .sampling import motion_speeds

STROKE_SLACK = 0.02
LIMIT_SLACK = 1.5
"""Drives overshoot their speed by tenths, and motors give half more than rated for a moment."""
TEMPERATURES_C = (-40.0, 150.0)


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
