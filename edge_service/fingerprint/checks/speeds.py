"""Checks of recorded speeds: each is the derivative of its position."""

from collections.abc import Sequence

from ...messages.channels import ANGLE, MOTOR_SPEED, TABLE_POSITION, TABLE_SPEED
from ...messages.samples import SampleFrame
from ...models.machine import Machine
from .channel_regression import regress_channel
from .check_result import CheckResult, Verdict, judge_factor

LONGEST_FILTER_S = 2e-3
"""Drives filter their speed by 0.3 to 1 ms."""


def check_motor_speed(_machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Hold the motor's speed against its angle."""
    return _speed(recordings, MOTOR_SPEED, ANGLE)


def check_table_speed(_machine: Machine, recordings: Sequence[SampleFrame]) -> CheckResult:
    """Hold the table's speed against its position."""
    return _speed(recordings, TABLE_SPEED, TABLE_POSITION)


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
