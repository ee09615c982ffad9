"""Alarms that call for a person, and the commands with which a person answers."""

from enum import StrEnum
from typing import Literal, Self

from pydantic import Field, model_validator

from .estimate import Frozen
from .event import Severity
from .names import check_recording
from .sentence import Sentence, is_none

MOST_KEY_LETTERS = 100


class AlarmKind(StrEnum):
    """Subject of an alarm."""

    PRELOAD_LOW = "preload_low"  # below the warning limit
    PRELOAD_LOST = "preload_lost"  # below the fault limit
    RATE = "rate"  # wears faster than allowed
    SUDDEN_DROP = "sudden_drop"
    MODEL = "model"  # the model no longer fits what is measured
    DATA_LOST = "data_lost"
    SERVICE = "service"  # a part of the service does not work


class Alarm(Frozen):
    """One alarm that is active, or that nobody has acknowledged yet.

    Attributes:
        active: whether its cause holds now.
        occurrence: number of this time that it was raised; each is greater than those before.
        message, sentence: its cause in English, and for readers of other languages.
        raised_time_ns, cleared_time_ns: UNIX times, ns, of the last change either way.
        acknowledged_by, note: who took note of it, and their words; None if nobody.
        shelved_until_ns: until then it calls nobody; None if not shelved.
    """

    kind: AlarmKind
    severity: Severity
    active: bool
    occurrence: int = Field(0, ge=0)
    message: str
    raised_time_ns: int
    cleared_time_ns: int | None = None
    acknowledged_by: str | None = None
    note: str = ""
    shelved_until_ns: int | None = None
    sentence: Sentence | None = Field(None, exclude_if=is_none)


class Command(Frozen):
    """Command given by a person about one axis.

    Attributes:
        action: `acknowledge`, `shelve` or `unshelve` an alarm; write a `note`; say that a part
            was replaced or set anew (`part_replaced`), which begins its trend and use anew; or that
            the trace named by the note is kept (`recorded`, from the service itself).
        alarm: the alarm meant; None for the other actions.
        occurrence: which time of that alarm `acknowledge` means; refused once that is over.
        user: who asks.
        note: their words.
        duration_s: how long to shelve, s.
        origin: address from which it was asked; empty for a client of the bus.
        key: of the asker's choice, so that the same command may be asked again after a lost answer
            without being done twice; empty: it is done each time.
    """

    action: Literal["acknowledge", "shelve", "unshelve", "note", "part_replaced", "recorded"]
    alarm: AlarmKind | None = None
    occurrence: int | None = Field(None, ge=0)
    user: str = Field(min_length=1, max_length=100)
    note: str = Field("", max_length=1000)
    duration_s: float = Field(8 * 3600.0, gt=0.0, le=30 * 86400.0)
    origin: str = Field("", max_length=200)
    key: str = Field("", max_length=MOST_KEY_LETTERS)

    @model_validator(mode="after")
    def _own_recording(self) -> Self:
        if self.action == "recorded":
            check_recording(self.note)
        return self


class Outcome(Frozen):
    """Outcome of a command.

    Attributes:
        accepted: whether it was done.
        kept: whether it is on the disk, so that it outlives a crash; True where nothing is kept.
        message: what was done, or why not.
        reused: whether the command was refused because its key belongs to another one.
    """

    accepted: bool
    kept: bool = True
    message: str = ""
    reused: bool = False
