"""Statements as a code with its values, and the events that carry one."""

from collections.abc import Mapping
from enum import StrEnum
from string import Formatter
from types import MappingProxyType
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from .interval import Frozen, TimeNs
from .keys import Kind, check_recording

Value = float | str


class AxisCondition(StrEnum):
    """Condition of an axis and level of a statement, in the words of MTConnect; worst first."""

    FAULT = "FAULT"
    WARNING = "WARNING"
    UNAVAILABLE = "UNAVAILABLE"
    NORMAL = "NORMAL"

    @property
    def urgency(self) -> int:
        """Rank, 0 for the least urgent."""
        return _URGENCY[self]


_URGENCY = {level: rank for rank, level in enumerate(reversed(AxisCondition))}


class Code(StrEnum):
    """Sentence; the codes never change."""

    PRELOAD_BACK = "preload_back"
    PRELOAD_LAST_KNOWN = "preload_last_known"
    PRELOAD_FALLING = "preload_falling"
    PRELOAD_FELL_LATELY = "preload_fell_lately"
    PRELOAD_FELL_SUDDENLY = "preload_fell_suddenly"
    AXIS_CHANGED = "axis_changed"
    MODEL_DISAGREES = "model_disagrees"
    PART_DOWN = "part_down"
    ALARM_OVER = "alarm_over"
    ALARM_SHELVED = "alarm_shelved"
    ALARM_ACKNOWLEDGED = "alarm_acknowledged"
    ALARM_UNSHELVED = "alarm_unshelved"
    ALARM_SHELF_OVER = "alarm_shelf_over"
    CONDITION_CHANGED = "condition_changed"
    CONDITION_CHANGED_FOR = "condition_changed_for"
    PRELOAD_ROSE = "preload_rose"
    AXIS_DIFFERS = "axis_differs"
    AXIS_AS_LEARNED = "axis_as_learned"
    DISAGREEMENT_RECORDED = "disagreement_recorded"
    CLOCK_SET_H = "clock_set_h"
    CLOCK_SET_S = "clock_set_s"
    DATA_FAULT = "data_fault"
    DATA_FAULT_OVER = "data_fault_over"
    NORMAL = "normal"
    WARNING = "warning"
    MAY_BE_WARNING = "may_be_warning"
    FAULT = "fault"
    MAY_BE_FAULT = "may_be_fault"
    STARTING = "starting"
    LEARNING = "learning"
    NO_DATA_YET = "no_data_yet"
    NO_DATA_SINCE = "no_data_since"
    NOT_MOVED = "not_moved"
    ONLY_UNDER_LOAD = "only_under_load"
    SENSOR_FAULTY = "sensor_faulty"
    MACHINE_FILE_LACKS = "machine_file_lacks"
    TOO_SLOW = "too_slow"
    NOT_KNOWN = "not_known"


ENGLISH = {
    Code.PRELOAD_BACK: "The preload is back at {value:g} % of fresh.",
    Code.PRELOAD_LAST_KNOWN: "The preload was {value:g} % of fresh when last known.",
    Code.PRELOAD_FALLING: "The preload is falling fast: {rate:.3g} % of fresh {per}.",
    Code.PRELOAD_FELL_LATELY: "The preload fell fast until {time}. No clear trend.",
    Code.PRELOAD_FELL_SUDDENLY: (
        "The preload dropped from {before:.0f} to {after:.0f} % of fresh at {time}."
    ),
    Code.AXIS_CHANGED: "The axis no longer behaves as commissioned: {watched} differs.",
    Code.MODEL_DISAGREES: "No preload explains the torque: check signals and machine file.",
    Code.PART_DOWN: "{component} does not work: {reason}.",
    Code.ALARM_OVER: "The alarm {alarm} held from {since} to {until}.",
    Code.ALARM_SHELVED: "alarm {alarm} shelved until {time} by {user}",
    Code.ALARM_ACKNOWLEDGED: "alarm {alarm} acknowledged by {user}",
    Code.ALARM_UNSHELVED: "alarm {alarm} unshelved by {user}",
    Code.ALARM_SHELF_OVER: "alarm {alarm} is no longer shelved: its time is over",
    Code.CONDITION_CHANGED: "The condition is {condition}.",
    Code.CONDITION_CHANGED_FOR: "The condition is {condition}: {reason}.",
    Code.PRELOAD_ROSE: (
        "The preload rose from {before:.3g} to {after:.3g} % of fresh, which wear cannot do. The "
        "trend starts again. If a part was replaced, note it."
    ),
    Code.AXIS_DIFFERS: (
        "The axis no longer behaves as commissioned: {watched} differs. {recording} is being "
        "recorded."
    ),
    Code.AXIS_AS_LEARNED: "The axis behaves as commissioned again: {watched}.",
    Code.DISAGREEMENT_RECORDED: "{recording} holds the disagreement, ready to diagnose.",
    Code.CLOCK_SET_H: "The clock of this computer was set {way} by {hours:.3g} h.",
    Code.CLOCK_SET_S: "The clock of this computer was set {way} by {seconds:.0f} s.",
    Code.DATA_FAULT: "Data fault: {fault}.",
    Code.DATA_FAULT_OVER: "Data fault over: {fault}.",
    Code.NORMAL: "The preload is within its limits: {value:g} % of fresh ({low:g} to {high:g}).",
    Code.WARNING: "The preload is low: {value:g} % of fresh ({low:g} to {high:g}).",
    Code.MAY_BE_WARNING: "The preload may be low: {value:g} % of fresh ({low:g} to {high:g}).",
    Code.FAULT: "The preload is lost: {value:g} % of fresh ({low:g} to {high:g}).",
    Code.MAY_BE_FAULT: "The preload may be lost: {value:g} % of fresh ({low:g} to {high:g}).",
    Code.STARTING: "The service is starting.",
    Code.LEARNING: "The first estimate needs a second of steady motion.",
    Code.NO_DATA_YET: "No data have come from the drive yet.",
    Code.NO_DATA_SINCE: "No data from the drive since {time}.",
    Code.NOT_MOVED: "The axis has not moved enough since {time}.",
    Code.ONLY_UNDER_LOAD: "It has moved only under load since {time}.",
    Code.SENSOR_FAULTY: "{sensor} is faulty: {reason}.",
    Code.MACHINE_FILE_LACKS: "The machine file lacks the {missing}.",
    Code.TOO_SLOW: "Samples come more slowly than commissioned.",
    Code.NOT_KNOWN: "The preload is not known at present: {reason}.",
}
"""Text of each code; a number has the digits with which it is sent."""


class Statement(Frozen):
    """Sentence in English, and as a code with its values for readers of other languages.

    Attributes:
        code: one of `Code`, or of a later version; empty where there is the text alone.
        values: by name: numbers with the digits that are shown, and codes, names or times.
    """

    code: str = ""
    text: str = ""
    values: dict[str, Value] = {}


SILENT = Statement()


def told(code: Code, words: Mapping[str, str] = MappingProxyType({}), **values: Value) -> Statement:
    """Statement of a code.

    Args:
        words: What stands in the English text instead of a value, or is told there alone.

    >>> told(Code.PRELOAD_BACK, value=27.0).text
    'The preload is back at 27 % of fresh.'
    """
    text = ENGLISH[code].format(**{**values, **words})
    specs = {name: spec for _, name, spec, _ in Formatter().parse(ENGLISH[code]) if name}
    sent = {
        name: value if isinstance(value, str) else float(format(value, specs[name] or ""))
        for name, value in values.items()
    }
    return Statement(code=code.value, text=text, values=sent)


def _whole_ms(time_ns: int) -> int:
    """The time as readers of JSON get it, so that an event that comes back is the same."""
    return time_ns // 1_000_000 * 1_000_000


class Event(Statement):
    """One event of one axis (or of the service, with an empty axis).

    Attributes:
        kind: e.g. `condition_changed`, `status_changed`, `component_changed`, `data_fault`.
        level: how grave it is.
        time_ns: UNIX time in ns, whole milliseconds; `at` in JSON.
        who, origin: who asked for it, and from where; empty if nobody did.
        data: the values that changed; `recording` names a trace that the service keeps.
    """

    axis: str
    kind: Kind
    level: AxisCondition
    time_ns: Annotated[TimeNs, AfterValidator(_whole_ms)] = Field(alias="at")
    data: dict[str, str | float | int | None] = {}
    who: str = Field("", max_length=100)
    origin: str = Field("", max_length=200)

    @model_validator(mode="after")
    def _own_recording(self) -> Self:
        name = self.data.get("recording")
        if name is not None:
            check_recording(str(name), self.axis)
        return self
