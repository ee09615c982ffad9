"""Something that happened and that people or programs may want to hear of."""

from enum import StrEnum
from typing import Self

from pydantic import Field, model_validator

from .estimate import Frozen
from .names import Kind, check_recording
from .sentence import Sentence, is_none


def is_empty(text: str) -> bool:
    """True of text that need not be written."""
    return not text


class Severity(StrEnum):
    """Level of attention that an event asks for."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Event(Frozen):
    """One event of one axis (or of the service, with an empty axis).

    Attributes:
        kind: e.g. `condition_changed`, `status_changed`, `component_changed`, `data_fault`.
        message, sentence: in English, and for readers of other languages.
        time_ns: UNIX time in ns.
        who, origin: who asked for it, and from where; empty if nobody did.
        data: the values that changed; `recording` names a trace that the service keeps.
    """

    axis: str
    kind: Kind
    severity: Severity
    message: str
    time_ns: int
    data: dict[str, str | float | int | None] = {}
    who: str = Field("", max_length=100, exclude_if=is_empty)
    origin: str = Field("", max_length=200, exclude_if=is_empty)
    sentence: Sentence | None = Field(None, exclude_if=is_none)

    @model_validator(mode="after")
    def _own_recording(self) -> Self:
        name = self.data.get("recording")
        if name is not None:
            check_recording(str(name), self.axis)
        return self
