"""Checks of channels by themselves: read in time, measured, and within what an axis can reach."""

import contextlib
import math
from collections.abc import Sequence
from collections.abc import Set as AbstractSet

import numpy as np

from ..messages.features import FAULT_WORDS, Fault
from ..messages.row_faults import THETA, T, U, X
from ..messages.samples import (
    ANGLE,
    CHANNELS,
    SETPOINT,
    TABLE_POSITION,
    TEMPERATURE,
    TIME,
    TORQUE,
    Floats,
    SampleFrame,
)
from ..models.machine import Machine
from ..recordings.columns import there_are
from ..recordings.conditioning import with_angle
from .channel_regression import regress_channel
from .columns.names import Quantity, column_names
from .finding import FACTOR_TOLERANCE, Finding, Verdict
from .live.channel_check import LONGER
from .live.excursions import longest_rows, mend
from .live.repeats import holds
from .positions import SPEEDS, Recordings
from .sampling import GAP_PERIODS, clock_of, motion_speeds, wrap_of
from .torque import INERTIA_FACTOR, measured_inertia

_MEASURED = {
    TORQUE: (U, Fault.TORQUE_STUCK, Fault.TORQUE_OUTLIERS),
    ANGLE: (THETA, Fault.ANGLE_STUCK, Fault.ANGLE_OUTLIERS),
    TABLE_POSITION: (X, Fault.TABLE_STUCK, Fault.TABLE_OUTLIERS),
}
POSITIONS = {ANGLE, TABLE_POSITION}
LEAST_S = 1.0
"""Shorter recordings may well repeat a value, and show no motion to be judged."""
_EFFORTS = (Quantity.TORQUE, Quantity.CURRENT, Quantity.FORCE)
STROKE_SLACK = 0.02
LIMIT_SLACK = 1.5
"""Drives overshoot their speed by tenths, and motors give half more than rated for a moment."""
MOST_DN_M_RAD_S = 16.0
"""Speed of a screw times its diameter, as catalogues have it: 150,000 r/min mm."""
TEMPERATURES_C = (-40.0, 150.0)
FASTEST_HZ = 1e5
"""No controller records an axis faster; a clock in minutes or hours would seem to."""
UNITS = {"milliseconds": "1e-3", "microseconds": "1e-6", "nanoseconds": "1e-9", "minutes": "60.0"}
"""Unit that a clock may count in place of seconds -> its scale to seconds."""
LEAST_MARKS = 3
"""Times that a value comes which stands for a missing one, and other values at the least."""
FEW = 5e-4
"""Share of samples that may seem to be none of a drive's."""


def check_rate(machine: Machine, recordings: Recordings) -> Finding:
    """Rate, gaps and jitter, and a unit of time that speeds and inertia contradict."""
    try:
        clock = clock_of([frame.time_s for frame in recordings])
    except ValueError as error:
        return Finding("rate", Verdict.DOUBTFUL, str(error), forbids=True)
    said = clock.as_text()
    odd = clock.is_slow or clock.rate_hz > FASTEST_HZ
    if odd and (unit := _other_unit(machine, recordings)):
        remedy = f"give the unit in columns.{TIME}, as in {{ column = ..., scale = {UNITS[unit]} }}"
        sentence = f"{TIME} looks like {unit}, not seconds: {said}"
        return Finding("rate", Verdict.DOUBTFUL, sentence, remedy=remedy, forbids=True)
    if clock.is_slow:
        said += "; too slow to follow the torque between samples: intervals will be wide"
        return Finding("rate", Verdict.DOUBTFUL, said, remedy="record faster if the controller can")
    if odd:
        return Finding("rate", Verdict.DOUBTFUL, f"{said}: no controller is so fast", forbids=True)
    return Finding("rate", Verdict.FITS, said)


def _other_unit(machine: Machine, recordings: Recordings) -> str:
    """Unit that every witness needs; nothing where there is none, or one contradicts.

    A speed is too large by the factor of the clock, an inertia by its square.
    """
    witnesses = []  # ratio to what it should be, and the factor by which it may be off
    for speed, position in SPEEDS:
        with contextlib.suppress(ValueError):
            factor = regress_channel(recordings, speed, position, derivative=1).factor
            if factor.determined and factor.low > 0.0:
                witnesses.append((factor.value, 1.0 + 5.0 * FACTOR_TOLERANCE))
    if any(TORQUE in frame.channels for frame in recordings):
        with contextlib.suppress(ValueError):
            inertia = measured_inertia(machine, recordings)
            if inertia.determined and inertia.low > 0.0:
                ratio = inertia.value / machine.model.inertia_kg_m2.value
                witnesses.append((math.sqrt(ratio), math.sqrt(INERTIA_FACTOR)))
    for unit, scale in UNITS.items():
        if witnesses and all(
            abs(math.log(ratio * float(scale))) < math.log(within) for ratio, within in witnesses
        ):
            return unit
    return ""


def check_columns(channels: AbstractSet[str], unread: Sequence[str]) -> Finding:
    """Find a torque that is missing, and the column that may hold it."""
    compared = "headers of the columns against the known channels"
    named = [name for name in unread if name]
    told = [] if TORQUE in channels else column_names(named)
    likely = [e.name for e in told if e.quantity in _EFFORTS or e.si_unit in ("N m", "A")]
    verdict, remedy = Verdict.DOUBTFUL, ""
    if TORQUE in channels and channels & {ANGLE, TABLE_POSITION}:
        verdict, sentence = Verdict.FITS, "torque and position are read"
    elif TORQUE in channels:
        sentence = f"neither {ANGLE} nor {TABLE_POSITION} is read"
    elif likely:
        sentence = f"no column is read as {TORQUE}, though {there_are(likely)}"
        remedy = f"add columns.{TORQUE} = {{ column = {likely[0]!r}, scale = ... }}"
    else:
        sentence = f"no column is read as {TORQUE}" + (f"; {there_are(named)}" if named else "")
        remedy = f"name the column of the torque or current in columns.{TORQUE}"
    forbids = bool(likely)
    return Finding("columns", verdict, sentence, compared=compared, remedy=remedy, forbids=forbids)


def check_signals(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Find channels without values, and those that keep one value to the last bit.

    A drive that holds an axis at rest still measures noise in its torque or its position.
    Raises ValueError: too short to tell.
    """
    if sum(float(np.ptp(frame.time_s)) for frame in recordings if len(frame)) < LEAST_S:
        raise ValueError(f"less than {LEAST_S:g} s")
    there = [name for name in CHANNELS if any(name in frame.channels for frame in recordings)]
    still = [name for name in there if not np.any(np.diff(_values(recordings, name)))]
    moving = {ANGLE, TABLE_POSITION, SETPOINT} & {*there} - {*still}
    stuck, forbids = [name for name in _MEASURED if name in still], True
    if stuck and not any(name in there and name not in still for name in _MEASURED):
        said = f"{', '.join(stuck)}: not one value changes: the device is off, or not connected"
    elif TORQUE in still and moving:
        fault = Fault.TORQUE_STUCK if _values(recordings, TORQUE).size else Fault.NO_TORQUE
        said = f"{TORQUE}: {FAULT_WORDS[fault]}"
    elif stuck and moving:
        said = "; ".join(f"{name}: {FAULT_WORDS[_MEASURED[name][1]]}" for name in stuck)
        forbids = False
    else:
        return Finding("signals", Verdict.FITS, "what is measured changes")
    return Finding("signals", Verdict.DOUBTFUL, said, forbids=forbids)


def check_samples(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    """Find samples that no drive can make, positions that wrap, and channels that are slower."""
    period_s = clock_of([frame.time_s for frame in recordings]).period_s
    usual_s = getattr(machine.commissioned, "hold_s", None) or (0.0, 0.0, 0.0)
    hold_s, bits = np.zeros(3), []
    for frame in with_angle(recordings, machine.transmission_ratio_m_per_rad):
        new = np.diff(frame.time_s, prepend=-np.inf) != 0.0
        rows = np.full((np.count_nonzero(new), X + 1), np.nan)
        rows[:, T] = frame.time_s[new]
        for name in _MEASURED.keys() & frame.channels.keys():
            rows[:, _MEASURED[name][0]] = frame.channels[name][new]
        held = holds(rows, np.full(3, np.nan), *np.zeros((3, 3)))
        hold_s = np.maximum(hold_s, period_s * (held - 1.0))
        bits.append(mend(rows, 0, len(rows), longest_rows(period_s)))
    turns = {(n, wrap_of(f.channels[n])) for f in recordings for n in {*f.channels} & POSITIONS}
    said = [f"{name} wraps, by {by:.4g}: unwrap it first" for name, by in sorted(turns) if by]
    found = np.concatenate(bits)
    for k, (read, (_, _, kind)) in enumerate(_MEASURED.items()):
        name = read if any(read in each.channels for each in recordings) else TABLE_POSITION
        if hold_s[k] > LONGER * usual_s[k] + 0.5 * period_s:
            said.append(f"{name} is new every {round(1e3 * (hold_s[k] + period_s), 1):g} ms only")
        if (share := float(np.mean(found & int(kind) != 0))) > FEW:
            said.append(f"{100.0 * share:.2g} % of {name} are values that no drive can make")
    marks = [(n, m) for n in _MEASURED if math.isfinite(m := _mark_of(recordings, n, period_s))]
    said += [f"{n} is {m:.5g} several times, far from all else: a missing value" for n, m in marks]
    if not said:
        return Finding("samples", Verdict.FITS, "each sample goes with its neighbours")
    forbids = any(by for _, by in turns) or bool(marks and not longest_rows(period_s))
    return Finding("samples", Verdict.DOUBTFUL, "; ".join(said), forbids=forbids)


def _mark_of(recordings: Sequence[SampleFrame], name: str, period_s: float) -> float:
    """Value that comes again, by a leap beyond the range of all others; NaN if none does.

    A place where the axis stands is as far off where the way to it is not recorded: no leap.
    """
    known, count = np.unique(_values(recordings, name), return_counts=True)
    leap = 0.0
    for frame in [frame for frame in recordings if name in frame.channels]:
        steps, moved = np.diff(frame.time_s), np.abs(np.diff(frame.channels[name]))
        leap = np.fmax.reduce(moved[steps < GAP_PERIODS * period_s], initial=leap)
    ends = ((0, known[1:]), (-1, known[:-1])) if len(known) > LEAST_MARKS else ()
    for end, others in ends:
        nearest = np.abs(others - known[end]).min()
        if count[end] >= LEAST_MARKS and leap >= nearest > np.ptp(others):
            return float(known[end])
    return math.nan


def check_stroke(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    stroke = machine.axis.stroke_m
    if stroke is None:
        return Finding("stroke", Verdict.UNKNOWN, "cannot tell: axis.stroke_m is missing")
    low, high = _range(recordings, TABLE_POSITION)
    sentence = f"table moves from {low:.4g} to {high:.4g} m of a stroke of {stroke:g} m"
    inside = max(-low, high - stroke) <= STROKE_SLACK * stroke
    return Finding("stroke", Verdict.FITS if inside else Verdict.DOUBTFUL, sentence)


def check_temperature(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    low, high = _range(recordings, TEMPERATURE)
    inside = TEMPERATURES_C[0] <= low and high <= TEMPERATURES_C[1]
    sentence = f"temperature from {low:.3g} to {high:.3g} degC"
    return Finding("temperature", Verdict.FITS if inside else Verdict.DOUBTFUL, sentence)


def check_limits(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    axis, said, exceeded = machine.axis, [], False
    top_rad_s, speed = axis.max_speed_rad_s, "speed"
    if top_rad_s is None and axis.screw_diameter_m:  # an angle in another unit is far beyond
        top_rad_s = MOST_DN_M_RAD_S / axis.screw_diameter_m
        speed = f"speed of a {1e3 * axis.screw_diameter_m:.3g} mm screw"
    for what, unit, limit, values in (
        (speed, "rad/s", top_rad_s, motion_speeds(machine, recordings)),
        ("torque", "N m", axis.max_torque_nm, _values(recordings, TORQUE)),
    ):
        if limit is not None and len(values):
            greatest = float(np.quantile(np.abs(values), 0.99))
            exceeded |= greatest > LIMIT_SLACK * limit
            said.append(f"{what} up to {greatest:.4g} {unit} of {limit:.3g}")
    if not said:
        raise ValueError(f"neither {TORQUE} nor {ANGLE}")
    return Finding("limits", Verdict.DOUBTFUL if exceeded else Verdict.FITS, "; ".join(said))


def _values(recordings: Sequence[SampleFrame], channel: str) -> Floats:
    held = [frame.channels[channel] for frame in recordings if channel in frame.channels]
    values: Floats = np.concatenate([*held, np.empty(0)])
    return values[np.isfinite(values)]


def _range(recordings: Sequence[SampleFrame], channel: str) -> tuple[float, float]:
    known = _values(recordings, channel)
    if known.size == 0:
        raise ValueError(f"{channel} in {CHANNELS[channel].unit} has no value")
    return float(known.min()), float(known.max())
