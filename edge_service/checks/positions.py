"""Checks of positions and speeds: lead, sign and time of both encoders, setpoint, derivatives."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from ..messages.samples import (
    ANGLE,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TABLE_SPEED,
    Floats,
    SampleFrame,
)
from ..models.machine import Machine
from ..regression.interval_estimate import IntervalEstimate
from ..regression.linear import least_squares
from .channel_regression import ChannelRegression, regress_channel
from .finding import Finding, Verdict, judge_factor, looks_wrong, usual_mistake

SPEEDS = ((MOTOR_SPEED, ANGLE), (TABLE_SPEED, TABLE_POSITION))
LEAST_LAG_S = 1e-4
"""A shorter lag between the encoders shows in no result."""
FOLLOWED = (0.2, 5.0)
"""Travel over that of the setpoint: beyond it no lag and no overshoot explains it, a unit does."""
LEAST_ROWS = 20
"""Rows of an unchanged setpoint that may be a rest: a cubic and its noise fill fewer."""
LAST_SHARE = 0.25
"""Of a rest: its end, when the axis has settled."""
SETTLED_SHARE = 0.01
"""Of the whole travel: what moves by more in that last part does not rest."""
LEAST_RESTS = 4
"""Rests for a factor, an offset and a scatter."""
LONGEST_FILTER_S = 2e-3
"""Drives filter their speed by 0.3 to 1 ms."""


class Recordings(tuple[SampleFrame, ...]):
    """Recordings of one axis, with what several checks ask of them."""

    @cached_property
    def encoders(self) -> ChannelRegression:
        """Regression of the linear on the rotary encoder. ValueError: as `regress_channel`."""
        return regress_channel(self, TABLE_POSITION, ANGLE, mechanics=True)


def check_lead(machine: Machine, recordings: Recordings) -> Finding:
    lead = recordings.encoders.factor.scaled(2e3 * math.pi, "mm")
    expected = 1e3 * machine.axis.lead_m
    found = judge_factor("lead", lead, expected, f"lead is {lead.value:.6g} mm")
    if found.verdict is not Verdict.DOUBTFUL:
        return found
    ratio = lead.value / expected
    sentence = other_lead(ratio, expected)
    known = ratio < 0.0 or (ratio > 0.0 and bool(usual_mistake(1.0 / ratio, ANGLE)))
    if known and _table_is_right(machine, recordings):
        sentence = looks_wrong(ANGLE, 1.0 / ratio)
    return Finding("lead", found.verdict, sentence, lead, expected, forbids=True)


def other_lead(ratio: float, stated_mm: float) -> str:
    """Lead over that of the machine file as a sentence."""
    if ratio < 0.0:
        return f"{TABLE_POSITION} runs against {ANGLE}: one of the signs looks inverted"
    said = f"lead looks like {ratio * stated_mm:.4g} mm, not {stated_mm:.4g}"
    angle, both = usual_mistake(1.0 / ratio, ANGLE), f"{TABLE_POSITION} over {ANGLE}"
    return said + (angle if "degrees" in angle else usual_mistake(ratio, both))


def angle_is_misread(machine: Machine, recordings: Recordings) -> bool:
    """Flag of a rotary encoder that contradicts a linear one which agrees with the setpoints."""
    with contextlib.suppress(ValueError):
        return check_lead(machine, recordings).sentence.startswith(ANGLE)
    return False


def check_encoder_lag(_machine: Machine, recordings: Recordings) -> Finding:
    lag, least_ms = recordings.encoders.lag.scaled(1e3, "ms"), 1e3 * LEAST_LAG_S
    verdict, sentence = Verdict.FITS, "both encoders are read at the same time"
    if not lag.determined:
        verdict, sentence = Verdict.UNKNOWN, f"cannot tell: {lag.note}"
    elif lag.low > least_ms or lag.high < -least_ms:
        way = "lags" if lag.value > 0.0 else "leads"
        verdict = Verdict.DOUBTFUL
        sentence = f"linear encoder {way} rotary by {abs(lag.value):.2g} ms"
    elif lag.high - lag.low > 10.0 * least_ms:
        verdict, sentence = Verdict.UNKNOWN, "too little motion to tell"
    return Finding("encoder_lag", verdict, sentence, lag, 0.0)


def check_setpoint(machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    has_table = any(TABLE_POSITION in frame.channels for frame in recordings)
    position = TABLE_POSITION if has_table else ANGLE
    unit = 1.0 if position == TABLE_POSITION else machine.transmission_ratio_m_per_rad
    factor = regress_channel(recordings, position, SETPOINT).factor.scaled(unit, "")
    found = judge_factor("setpoint", factor, 1.0, f"{position} follows {SETPOINT}", position)
    if found.verdict is Verdict.FITS:
        return found
    beyond = not FOLLOWED[0] < factor.value < FOLLOWED[1]
    at_rest = factor_at_rest(recordings, position, SETPOINT)
    if at_rest is not None:
        said = f"{position} reaches {SETPOINT} at rest, and is late or overshoots in motion"
        rested = judge_factor("setpoint", at_rest.scaled(unit, ""), 1.0, said, position)
        return replace(rested, forbids=rested.is_doubtful and beyond)
    if not found.is_doubtful or beyond:
        return replace(found, forbids=found.is_doubtful)
    sentence = f"cannot tell: {position} lags behind or overshoots, and never rests twice"
    return Finding("setpoint", Verdict.UNKNOWN, sentence, factor, 1.0)


def _table_is_right(machine: Machine, recordings: Sequence[SampleFrame]) -> bool:
    with contextlib.suppress(ValueError):
        return check_setpoint(machine, recordings).verdict is Verdict.FITS
    return False


def factor_at_rest(
    recordings: Sequence[SampleFrame], position: str, setpoint: str
) -> IntervalEstimate | None:
    """Factor of the position over its setpoint from where both rest; None without such rests."""
    rests = [
        pair
        for frame in recordings
        if {position, setpoint} <= frame.channels.keys()
        for pair in _rests(frame.channels[position], frame.channels[setpoint])
    ]
    pairs = np.array(rests).reshape(-1, 2)
    if len(pairs) < LEAST_RESTS or np.ptp(pairs[:, 1]) == 0.0:
        return None
    around = pairs - pairs.mean(axis=0)
    return least_squares(("factor",), around[:, 1:], around[:, 0]).interval_estimate("factor", "")


def _rests(position: Floats, setpoint: Floats) -> Iterator[tuple[float, float]]:
    known = np.isfinite(position) & np.isfinite(setpoint)
    position, setpoint = position[known], setpoint[known]
    if not len(position):
        return
    settled = SETTLED_SHARE * float(np.ptp(position))
    for stretch in np.split(np.arange(len(setpoint)), np.flatnonzero(np.diff(setpoint)) + 1):
        if len(stretch) < LEAST_ROWS:
            continue
        last = position[stretch[-max(round(LAST_SHARE * len(stretch)), 2) :]]
        if float(np.ptp(last)) <= settled:
            yield float(last.mean()), float(setpoint[stretch[0]])


def check_motor_speed(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    return _speed(recordings, MOTOR_SPEED, ANGLE)


def check_table_speed(_machine: Machine, recordings: Sequence[SampleFrame]) -> Finding:
    return _speed(recordings, TABLE_SPEED, TABLE_POSITION)


def speed_doubts(recordings: Sequence[SampleFrame]) -> list[str]:
    """One line for each speed that is not the derivative of its position."""
    found = []
    for speed, position in SPEEDS:
        with contextlib.suppress(ValueError):
            if (finding := _speed(recordings, speed, position)).is_doubtful:
                found.append(f"{finding.sentence}; check their scales under [columns]")
    return found


def _speed(recordings: Sequence[SampleFrame], speed: str, position: str) -> Finding:
    name = speed.removesuffix("_rad_s").removesuffix("_m_s")
    relation = regress_channel(recordings, speed, position, derivative=1)
    said = f"{speed} is the derivative of {position}"
    found = judge_factor(name, relation.factor, 1.0, said, speed)
    lag = relation.lag
    if found.verdict is Verdict.FITS and lag.determined and lag.low > LONGEST_FILTER_S:
        sentence = f"{speed} comes {1e3 * lag.value:.2g} ms later than {position}"
        return Finding(name, Verdict.DOUBTFUL, sentence, lag.scaled(1e3, "ms"), 0.0)
    return found
