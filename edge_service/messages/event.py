"""Statements as a code with its values, and the events that carry one."""

from collections.abc import Mapping
from enum import Enum, StrEnum
from string import Formatter
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from .interval import Frozen, TimeNs
from .keys import Kind, check_recording


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


class Code(Enum):
    """Code of a sentence, its name in small letters, which never changes; the value is its text.

    A number has the digits with which it is sent.
    """

    PRELOAD_BACK = "The preload is back at {value:g} % of fresh."
    PRELOAD_LAST_KNOWN = "The preload was {value:g} % of fresh when last known."
    PRELOAD_FALLING = "The preload is falling fast: {rate:.3g} % of fresh {per}."
    PRELOAD_FELL_LATELY = "The preload fell fast until {time}. No clear trend."
    PRELOAD_FELL_SUDDENLY = (
        "The preload dropped from {before:.0f} to {after:.0f} % of fresh at {time}."
    )
    AXIS_CHANGED = "The axis no longer behaves as commissioned: {watched} differs."
    MODEL_DISAGREES = "No preload explains the torque: check signals and machine file."
    PART_DOWN = "{component} does not work: {reason}."
    COMPONENT_CHANGED = "{component} is {part}{reason}"
    ALARM_OVER = "The alarm “{alarm}” held from {since} to {until}."
    ALARM_SHELVED = "alarm “{alarm}” shelved until {time} by {user}"
    ALARM_ACKNOWLEDGED = "alarm “{alarm}” acknowledged by {user}"
    ALARM_UNSHELVED = "alarm “{alarm}” unshelved by {user}"
    ALARM_SHELF_OVER = "alarm “{alarm}” is no longer shelved: its time is over"
    CONDITION_CHANGED = "The condition is {condition}."
    CONDITION_CHANGED_FOR = "The condition is {condition}: {reason}."
    PRELOAD_ROSE = (
        "The preload rose from {before:.3g} to {after:.3g} % of fresh, which wear cannot do. The "
        "trend starts again. If a part was replaced, note it."
    )
    AXIS_DIFFERS = (
        "The axis no longer behaves as commissioned: {watched} differs. {recording} is being "
        "recorded."
    )
    AXIS_AS_LEARNED = "The axis behaves as commissioned again: {watched}."
    DISAGREEMENT_RECORDED = "{recording} holds the disagreement, ready to diagnose."
    TESTED = "The test by shaking says {value:.3g} % of fresh ({low:.3g} to {high:.3g})."
    CLOCK_SET_H = "The clock of this computer was set {way} by {hours:.3g} h."
    CLOCK_SET_S = "The clock of this computer was set {way} by {seconds:.0f} s."
    DATA_FAULT = "Data fault: {fault}."
    DATA_FAULT_OVER = "Data fault over: {fault}."
    NORMAL = "The preload is within its limits: {value:g} % of fresh ({low:g} to {high:g})."
    WARNING = "The preload is low: {value:g} % of fresh ({low:g} to {high:g})."
    MAY_BE_WARNING = "The preload may be low: {value:g} % of fresh ({low:g} to {high:g})."
    FAULT = "The preload is lost: {value:g} % of fresh ({low:g} to {high:g})."
    MAY_BE_FAULT = "The preload may be lost: {value:g} % of fresh ({low:g} to {high:g})."
    STARTING = "The service is starting."
    LEARNING = "The first estimate needs a second of steady motion."
    NO_DATA_YET = "No data have come from the drive yet."
    NO_DATA_SINCE = "No data from the drive since {time}."
    NOT_MOVED = "The axis has not moved enough since {time}."
    ONLY_UNDER_LOAD = "It has moved only under load since {time}."
    SENSOR_FAULTY = "{sensor} is faulty: {reason}."
    MACHINE_FILE_LACKS = "The machine file lacks {missing}."
    TOO_SLOW = "Samples come more slowly than commissioned."
    ESTIMATE_ANEW = "The estimate starts over: its state cannot be continued ({reason})"
    STARTED = "edge-service {version} started: {parts}"
    PART_REPLACED = "part replaced by {user}"
    COMMAND_REFUSED = "{command} {alarm} was refused: {reason}"
    ESTIMATED = "The preload is estimated."
    NOT_KNOWN = "The preload is not known at present: {reason}."


class Statement(Frozen):
    """Sentence in English, and as a code with its values for readers of other languages.

    Attributes:
        code: one of `Code`, or of a later version; empty where there is the text alone.
        values: by name: numbers with the digits that are shown, and codes, names or times.
    """

    code: str = ""
    text: str = ""
    values: dict[str, float | str] = {}


SILENT = Statement()


def told(code: Code, words: Mapping[str, str] | None = None, **values: float | str) -> Statement:
    """Statement of a code.

    Args:
        words: What stands in the English text instead of a value, or is told there alone.

    >>> told(Code.PRELOAD_BACK, value=27.0).text
    'The preload is back at 27 % of fresh.'
    """
    text = code.value.format(**{**values, **(words or {})})
    specs = {name: spec for _, name, spec, _ in Formatter().parse(code.value) if name}
    sent = {
        name: value if isinstance(value, str) else float(format(value, specs[name] or ""))
        for name, value in values.items()
    }
    return Statement(code=code.name.lower(), text=text, values=sent)


class Event(Statement):
    """One event of one axis (or of the service, with an empty axis).

    Attributes:
        kind: e.g. `condition_changed`, `status_changed`, `component_changed`, `data_fault`.
        time_ns: UNIX time in ns, whole milliseconds; `at` in JSON.
        who, origin: who asked for it, and from where; empty if nobody did.
        data: the values that changed; `recording` names a trace that the service keeps.
    """

    axis: str
    kind: Kind
    level: AxisCondition
    time_ns: Annotated[TimeNs, AfterValidator(lambda ns: ns - ns % 1_000_000)] = Field(alias="at")
    data: dict[str, str | float | int | None] = {}
    who: str = Field("", max_length=100)
    origin: str = Field("", max_length=200)

    @model_validator(mode="after")
    def _own_recording(self) -> Self:
        if (name := self.data.get("recording")) is not None:
            check_recording(str(name), self.axis)
        return self
