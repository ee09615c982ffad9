"""Check that channels have the units and signs that the machine file expects.

Every answer is a number with an interval, held against the machine file, in one sentence: "torque
sign looks inverted", "lead looks like 10 mm, not 20", "linear encoder lags rotary by 0.8 ms".
"""

import math
from collections.abc import Callable, Sequence

import numpy as np

from ...messages.channels import (
    ANGLE,
    CHANNELS,
    MOTOR_SPEED,
    SETPOINT,
    TABLE_POSITION,
    TABLE_SPEED,
    TEMPERATURE,
    TORQUE,
)
from ...messages.samples import Floats, SampleFrame
from ...models.machine import Machine
from ..regression.inverse_dynamics import identify_inverse_dynamics
from ..regression.prepared_run import PreparationSettings
from .channel_regression import CUTOFF_HZ, ChannelRegression, regress_channel
from .check_result import CheckResult, Verdict, judge_factor, usual_mistake, wrongly

INERTIA_FACTOR = 2.0
"""A load changes the inertia by less than this factor; beyond it the torque's unit is another."""
LEAST_LAG_S = 1e-4
"""A shorter lag between the encoders shows in no result."""
LONGEST_FILTER_S = 2e-3
"""Drives filter their speed by 0.3 to 1 ms."""
LEAST_RATE_HZ = 50.0
RATE_SLACK = 0.05
"""A source that is asked at 50 Hz answers at 49.7."""
STROKE_SLACK = 0.02
TEMPERATURES_C = (-40.0, 150.0)


def check_plausibility(machine: Machine, recordings: Sequence[SampleFrame]) -> list[CheckResult]:
    """Every check that the channels allow, in a fixed order."""
    channels = {name for frame in recordings for name in frame.channels}
    checks: list[tuple[str, set[str], Callable[[], CheckResult]]] = [
        ("rate", set(), lambda: _rate(recordings)),
        ("lead", {ANGLE, TABLE_POSITION}, lambda: _lead(machine, recordings)),
        ("encoder_lag", {ANGLE, TABLE_POSITION}, lambda: _lag(_encoders(recordings))),
        ("setpoint", {SETPOINT}, lambda: _setpoint(machine, recordings)),
        ("motor_speed", {ANGLE, MOTOR_SPEED}, lambda: _speed(recordings, MOTOR_SPEED, ANGLE)),
        (
            "table_speed",
            {TABLE_POSITION, TABLE_SPEED},
            lambda: _speed(recordings, TABLE_SPEED, TABLE_POSITION),
        ),
        ("torque", {TORQUE}, lambda: _torque(machine, recordings)),
        ("stroke", {TABLE_POSITION}, lambda: _stroke(machine, recordings)),
        ("temperature", {TEMPERATURE}, lambda: _temperature(recordings)),
    ]
    return [_judged(name, check) for name, needed, check in checks if needed <= channels]


def _judged(name: str, check: Callable[[], CheckResult]) -> CheckResult:
    try:
        return check()
    except ValueError as error:
        return CheckResult(name, Verdict.UNKNOWN, f"cannot tell: {' '.join(str(error).split())}")


def _encoders(recordings: Sequence[SampleFrame]) -> ChannelRegression:
    return regress_channel(recordings, TABLE_POSITION, ANGLE, mechanics=True)


def _lead(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
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
    return CheckResult("lead", found.verdict, sentence, lead, expected)


def _misread_angle(ratio: float) -> str:
    """Description of the angle's error if the table is right; nothing where it may be the lead."""
    reason = usual_mistake(abs(1.0 / ratio), ANGLE)
    if ratio > 0.0 and not reason:
        return ""
    return f"{ANGLE} looks {wrongly(1.0 / ratio)}{reason}"


def _table_is_right(machine: Machine, recordings: Sequence[SampleFrame]) -> bool:
    """Tell whether the linear encoder agrees with the setpoints."""
    try:
        return _setpoint(machine, recordings).verdict is Verdict.FITS
    except ValueError:
        return False


def _lag(encoders: ChannelRegression) -> CheckResult:
    lag = encoders.lag.scaled(1e3, "ms")
    if not lag.determined:
        return CheckResult("encoder_lag", Verdict.UNKNOWN, f"cannot tell: {lag.note}", lag, 0.0)
    least_ms = 1e3 * LEAST_LAG_S
    if lag.low > least_ms:
        sentence = f"linear encoder lags rotary by {lag.value:.2g} ms"
        return CheckResult("encoder_lag", Verdict.DOUBTFUL, sentence, lag, 0.0)
    if lag.high < -least_ms:
        sentence = f"linear encoder leads rotary by {-lag.value:.2g} ms"
        return CheckResult("encoder_lag", Verdict.DOUBTFUL, sentence, lag, 0.0)
    if lag.high - lag.low > 10.0 * least_ms:
        return CheckResult("encoder_lag", Verdict.UNKNOWN, "too little motion to tell", lag, 0.0)
    return CheckResult("encoder_lag", Verdict.FITS, "both encoders tell the same time", lag, 0.0)


def _setpoint(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    has_table = any(TABLE_POSITION in frame.channels for frame in recordings)
    position = TABLE_POSITION if has_table else ANGLE
    unit = 1.0 if position == TABLE_POSITION else machine.transmission_ratio_m_per_rad
    factor = regress_channel(recordings, position, SETPOINT).factor.scaled(unit, "")
    return judge_factor("setpoint", factor, 1.0, f"{position} follows {SETPOINT}", position)


def _speed(recordings: Sequence[SampleFrame], speed: str, position: str) -> CheckResult:
    name = speed.removesuffix("_rad_s").removesuffix("_m_s")
    relation = regress_channel(recordings, speed, position, derivative=1)
    said = f"{speed} is the derivative of {position}"
    found = judge_factor(name, relation.factor, 1.0, said, speed)
    lag = relation.lag
    if found.verdict is Verdict.FITS and lag.determined and lag.low > LONGEST_FILTER_S:
        sentence = f"{speed} comes {1e3 * lag.value:.2g} ms later than {position}"
        return CheckResult(name, Verdict.DOUBTFUL, sentence, lag.scaled(1e3, "ms"), 0.0)
    return found


def _torque(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    able = [frame for frame in recordings if TORQUE in frame.channels]
    if _angle_is_wrong(machine, able):
        able = [_without_angle(frame) for frame in able]
    fit = identify_inverse_dynamics(
        able, PreparationSettings.sampled(machine.transmission_ratio_m_per_rad, able, CUTOFF_HZ)
    )
    inertia, coulomb = fit.parameters["inertia"], fit.parameters["coulomb"]
    expected = machine.model.inertia_kg_m2.value
    if not inertia.determined or inertia.holds(0.0):
        sentence = "cannot tell: too little acceleration"
        return CheckResult("torque", Verdict.UNKNOWN, sentence, inertia, expected)
    if inertia.high < 0.0:
        both = coulomb.determined and coulomb.high < 0.0
        sentence = "torque sign looks inverted: " + (
            "inertia and friction read negative" if both else "inertia reads negative"
        )
        return CheckResult("torque", Verdict.DOUBTFUL, sentence, inertia, expected)
    if inertia.low > INERTIA_FACTOR * expected or inertia.high < expected / INERTIA_FACTOR:
        ratio = inertia.value / expected
        sentence = f"torque looks {wrongly(ratio)}" + usual_mistake(ratio, TORQUE)
        return CheckResult("torque", Verdict.DOUBTFUL, sentence, inertia, expected)
    if coulomb.determined and coulomb.high < 0.0:
        sentence = "friction reads negative: sign of torque or motion, or a load that pulls"
        return CheckResult("torque", Verdict.DOUBTFUL, sentence, coulomb, 0.0)
    sentence = "torque has the sign and the size that the inertia needs"
    return CheckResult("torque", Verdict.FITS, sentence, inertia, expected)


def _angle_is_wrong(machine: Machine, recordings: Sequence[SampleFrame]) -> bool:
    """Tell whether the rotary encoder contradicts a linear one that agrees with the setpoints."""
    try:
        misread = _lead(machine, recordings).sentence.startswith(ANGLE)
    except ValueError:
        return False
    return misread


def _without_angle(frame: SampleFrame) -> SampleFrame:
    channels = {name: values for name, values in frame.channels.items() if name != ANGLE}
    return SampleFrame(frame.time_s, channels)


def _stroke(machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    stroke = machine.axis.stroke_m
    if stroke is None:
        return CheckResult("stroke", Verdict.UNKNOWN, "cannot tell: axis.stroke_m is missing")
    low, high = _range(recordings, TABLE_POSITION)
    sentence = f"table moves from {low:.4g} to {high:.4g} m of a stroke of {stroke:g} m"
    slack = STROKE_SLACK * stroke
    inside = -slack <= low and high <= stroke + slack
    return CheckResult("stroke", Verdict.FITS if inside else Verdict.DOUBTFUL, sentence)


def _temperature(recordings: Sequence[SampleFrame]) -> CheckResult:
    low, high = _range(recordings, TEMPERATURE)
    inside = TEMPERATURES_C[0] <= low and high <= TEMPERATURES_C[1]
    sentence = f"temperature from {low:.3g} to {high:.3g} degC"
    return CheckResult("temperature", Verdict.FITS if inside else Verdict.DOUBTFUL, sentence)


def _rate(recordings: Sequence[SampleFrame]) -> CheckResult:
    steps = np.concatenate([np.diff(frame.time_s) for frame in recordings])
    forward = steps[steps > 0.0]
    if forward.size == 0:
        raise ValueError("time_s never increases")
    period_s = float(np.median(forward))
    gaps = int(np.count_nonzero(forward > 1.5 * period_s))
    jitter = float(np.percentile(np.abs(forward - period_s), 95.0)) / period_s
    sentence = f"{1.0 / period_s:.4g} samples/s, {gaps} gaps, jitter {100.0 * jitter:.2g} %"
    backwards = int(np.count_nonzero(steps <= 0.0))
    if backwards:
        sentence += f", {backwards} times repeated or running backwards"
    if 1.0 / period_s < (1.0 - RATE_SLACK) * LEAST_RATE_HZ:
        sentence += "; too slow to know the torque between samples: intervals will be wide"
        return CheckResult("rate", Verdict.DOUBTFUL, sentence)
    return CheckResult("rate", Verdict.FITS, sentence)


def _range(recordings: Sequence[SampleFrame], channel: str) -> tuple[float, float]:
    values: Floats = np.concatenate(
        [frame.channels[channel] for frame in recordings if channel in frame.channels]
    )
    known = values[np.isfinite(values)]
    if known.size == 0:
        raise ValueError(f"{channel} in {CHANNELS[channel].unit} has no value")
    return float(known.min()), float(known.max())
