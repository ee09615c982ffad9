"""Commands with which a person answers, and what comes of them."""

from typing import Literal, Self

from pydantic import Field, model_validator

from .health import AlarmKind
from .interval import Frozen
from .keys import check_recording

MOST_KEY_LETTERS = 100


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
