"""Checks of positions: lead, time and sign of both encoders, and the setpoint at rest."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

from ...messages.channels import ANGLE, SETPOINT, TABLE_POSITION
from ...messages.samples import SampleFrame
from ...models.machine import Machine
from .channel_regression import ChannelRegression, regress_channel
from .check_result import CheckResult, Verdict, judge_factor, usual_mistake, wrongly
from .rests import factor_at_rest

LEAST_LAG_S = 1e-4
"""A shorter lag between the encoders shows in no result."""
FOLLOWED = (0.2, 5.0)
"""Travel over that of the setpoint: beyond it no lag and no overshoot explains it, a unit does."""


def check_lead(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Hold the travel of the table per turn against the stated lead."""
    lead = _encoders(recordings).factor.scaled(2e3 * math.pi, "mm")
    expected = 1e3 * machine.axis.lead_m
    found = judge_factor("lead", lead, expected, f"lead is {lead.value:.6g} mm")
    if found.verdict is not Verdict.DOUBTFUL:
        return found
    ratio = lead.value / expected
    blamed = _misread_angle(ratio) if _table_is_right(machine, recordings) else ""
    if blamed:
        sentence = blamed
    elif ratio < 0.0:
        sentence = f"{TABLE_POSITION} runs against {ANGLE}: one of the signs looks inverted"
    else:
        sentence = f"lead looks like {lead.value:.4g} mm, not {expected:.4g}"
        sentence += usual_mistake(ratio, f"{TABLE_POSITION} over {ANGLE}")
    return CheckResult("lead", found.verdict, sentence, lead, expected, forbids=True)


def angle_is_misread(machine: Machine, recordings: Sequence[SampleFrame]) -> bool:
    """Tell whether the rotary encoder contradicts a linear one that agrees with the setpoints."""
    try:
        return check_lead(machine, recordings).sentence.startswith(ANGLE)
    except ValueError:
        return False


def check_encoder_lag(_machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Hold the clock of one encoder against that of the other."""
    lag = _encoders(recordings).lag.scaled(1e3, "ms")
    name, least_ms = "encoder_lag", 1e3 * LEAST_LAG_S
    if not lag.determined:
        return CheckResult(name, Verdict.UNKNOWN, f"cannot tell: {lag.note}", lag, 0.0)
    if lag.low > least_ms:
        sentence = f"linear encoder lags rotary by {lag.value:.2g} ms"
        return CheckResult(name, Verdict.DOUBTFUL, sentence, lag, 0.0)
    if lag.high < -least_ms:
        sentence = f"linear encoder leads rotary by {-lag.value:.2g} ms"
        return CheckResult(name, Verdict.DOUBTFUL, sentence, lag, 0.0)
    if lag.high - lag.low > 10.0 * least_ms:
        return CheckResult(name, Verdict.UNKNOWN, "too little motion to tell", lag, 0.0)
    return CheckResult(name, Verdict.FITS, "both encoders are read at the same time", lag, 0.0)


def check_setpoint(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Hold the position against its setpoint, and where it lags or overshoots, at rest."""
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
    return CheckResult("setpoint", Verdict.UNKNOWN, sentence, factor, 1.0)


def _encoders(recordings: Sequence[SampleFrame]) -> ChannelRegression:
    return _encoders_of(tuple(recordings))


@functools.lru_cache(maxsize=1)
def _encoders_of(recordings: tuple[SampleFrame, ...]) -> ChannelRegression:
    """Regression of both encoders, which three checks of one examination ask for."""
    return regress_channel(recordings, TABLE_POSITION, ANGLE, mechanics=True)


def forget_encoders() -> None:
    """Let go of the recordings that were asked about last."""
    _encoders_of.cache_clear()


def _misread_angle(ratio: float) -> str:
    """Description of the angle's error if the table is right; nothing where it may be the lead."""
    reason = usual_mistake(abs(1.0 / ratio), ANGLE)
    if ratio > 0.0 and not reason:
        return ""
    return f"{ANGLE} looks {wrongly(1.0 / ratio)}{reason}"


def _table_is_right(machine: Machine, recordings: Sequence[SampleFrame]) -> bool:
    """Tell whether the linear encoder agrees with the setpoints."""
    if not any(SETPOINT in frame.channels for frame in recordings):
        return False
    try:
        return check_setpoint(machine, recordings).verdict is Verdict.FITS
    except ValueError:
        return False
