"""Sentences of the service: a code with its values, for readers of any language."""

from collections.abc import Mapping
from enum import StrEnum
from string import Formatter
from types import MappingProxyType
from typing import Any, NamedTuple

from .estimate import Frozen

Value = float | str


class Code(StrEnum):
    """Sentence; the codes never change."""

    PRELOAD_BELOW = "preload_below"
    PRELOAD_MAY_BE_BELOW = "preload_may_be_below"
    PRELOAD_BACK = "preload_back"
    PRELOAD_LAST_KNOWN = "preload_last_known"
    PRELOAD_FALLING = "preload_falling"
    PRELOAD_FELL_LATELY = "preload_fell_lately"
    PRELOAD_FELL_SUDDENLY = "preload_fell_suddenly"
    AXIS_CHANGED = "axis_changed"
    MODEL_DISAGREES = "model_disagrees"
    MODEL_MISFIT = "model_misfit"
    DATA_LOST = "data_lost"
    PART_DOWN = "part_down"
    ALARM_CLEARED = "alarm_cleared"
    ALARM_ACKNOWLEDGED = "alarm_acknowledged"
    ALARM_SHELVED_H = "alarm_shelved_h"
    ALARM_SHELVED_MIN = "alarm_shelved_min"
    ALARM_UNSHELVED = "alarm_unshelved"
    ALARM_SHELF_OVER = "alarm_shelf_over"
    CONDITION_CHANGED = "condition_changed"
    CONDITION_CHANGED_FOR = "condition_changed_for"
    PRELOAD_ROSE = "preload_rose"
    PRELOAD_ROSE_OF_RATING = "preload_rose_of_rating"
    AXIS_DIFFERS = "axis_differs"
    AXIS_AS_LEARNED = "axis_as_learned"
    DISAGREEMENT_RECORDED = "disagreement_recorded"
    CLOCK_SET_H = "clock_set_h"
    CLOCK_SET_S = "clock_set_s"
    DATA_FAULT = "data_fault"
    DATA_FAULT_OVER = "data_fault_over"


ENGLISH = {
    Code.PRELOAD_BELOW: (
        "preload at {percent:.0f} % of the fresh screw's; limit {limit:.0f} %, cleared above "
        "{release:.0f} %"
    ),
    Code.PRELOAD_MAY_BE_BELOW: (
        "preload at {percent:.0f} % of the fresh screw's, or at up to {high:.0f} %; limit "
        "{limit:.0f} %, cleared above {release:.0f} %"
    ),
    Code.PRELOAD_BACK: "preload back at {percent:.0f} % of the fresh screw's",
    Code.PRELOAD_LAST_KNOWN: "preload when last known: {percent:.0f} % of the fresh screw's",
    Code.PRELOAD_FALLING: (
        "preload falling by {loss:.3g} % of the fresh screw's {per}; limit {limit:g} % per 1000 h"
    ),
    Code.PRELOAD_FELL_LATELY: "fast loss of preload until lately; no clear trend at present",
    Code.PRELOAD_FELL_SUDDENLY: (
        "preload fell suddenly by {points:.0f} points, from {before:.0f} to {after:.0f} % of the "
        "fresh screw's"
    ),
    Code.AXIS_CHANGED: "not as when the axis was learned: {watched}",
    Code.MODEL_DISAGREES: "model and measurement disagree, or the data are faulty",
    Code.MODEL_MISFIT: "model does not fit: its squared errors {times:.1f} times as expected",
    Code.DATA_LOST: "data lost: {reason}",
    Code.PART_DOWN: "{component} does not work: {reason}",
    Code.ALARM_CLEARED: "alarm {alarm} has cleared",
    Code.ALARM_ACKNOWLEDGED: "alarm {alarm} acknowledged by {user}",
    Code.ALARM_SHELVED_H: "alarm {alarm} shelved for {hours:.3g} h by {user}",
    Code.ALARM_SHELVED_MIN: "alarm {alarm} shelved for {minutes:.2g} min by {user}",
    Code.ALARM_UNSHELVED: "alarm {alarm} unshelved by {user}",
    Code.ALARM_SHELF_OVER: "alarm {alarm} is no longer shelved: its time is over",
    Code.CONDITION_CHANGED: "condition is {condition}",
    Code.CONDITION_CHANGED_FOR: "condition is {condition}: {reason}",
    Code.PRELOAD_ROSE: (
        "preload rose from {before:.3g} to {after:.3g} % of the fresh screw's, which wear "
        "cannot do; the trend starts again; if a part was replaced, note it"
    ),
    Code.PRELOAD_ROSE_OF_RATING: (
        "preload rose from {before:.3g} to {after:.3g} % of the load rating, which wear cannot "
        "do; the trend starts again; if a part was replaced, note it"
    ),
    Code.AXIS_DIFFERS: (
        "the axis is not as when it was learned: {watched} is off by {times:.1f} times as much "
        "as then; {recording} is being recorded"
    ),
    Code.AXIS_AS_LEARNED: "the axis is as it was learned again: {watched}",
    Code.DISAGREEMENT_RECORDED: "{recording} holds the disagreement, ready to diagnose",
    Code.CLOCK_SET_H: "the clock of this computer was set {way} by {hours:.2f} h",
    Code.CLOCK_SET_S: "the clock of this computer was set {way} by {seconds:.0f} s",
    Code.DATA_FAULT: "data fault present: {fault}",
    Code.DATA_FAULT_OVER: "data fault over: {fault}",
}
"""Text of each code; a number has the digits with which it is sent."""


class Sentence(Frozen):
    """Sentence as it is sent.

    Attributes:
        code: one of `Code`, or of a later version.
        values: by name: numbers with the digits that are shown, and codes or names.
    """

    code: str
    values: dict[str, Value] = {}


class Told(NamedTuple):
    """Sentence in English, and as it is sent; without a sentence there is nothing to translate."""

    text: str
    sentence: Sentence | None = None


def told(code: Code, words: Mapping[str, str] = MappingProxyType({}), **values: Value) -> Told:
    """Sentence of a code.

    Args:
        words: What stands in the English text instead of a value, or is told there alone.

    >>> told(Code.PRELOAD_BACK, percent=27.4)[0]
    "preload back at 27 % of the fresh screw's"
    """
    text = ENGLISH[code].format(**{**values, **words})
    specs = {name: spec for _, name, spec, _ in Formatter().parse(ENGLISH[code]) if name}
    sent = {name: _shown(value, specs[name] or "") for name, value in values.items()}
    return Told(text, Sentence(code=code.value, values=sent))


def _shown(value: Value, spec: str) -> Value:
    return value if isinstance(value, str) else float(format(value, spec))


def is_none(value: Any) -> bool:
    """Tell whether a member is absent, so that it is not sent either."""
    return value is None
