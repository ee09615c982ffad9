"""Headline of an axis and advice to whoever works at it (advisory generation, ISO 13374-1)."""

from enum import StrEnum

from .estimate import Frozen


class Level(StrEnum):
    """Level of a headline: what it asks of whoever reads it."""

    OK = "ok"
    UNKNOWN = "unknown"
    ATTENTION = "attention"
    ACT = "act"


class Headline(Frozen):
    """The one statement about an axis, from the worst of its condition and its alarms.

    Attributes:
        code: the condition or kind of alarm that it rests on, in small letters.
        text: one sentence for people.
    """

    level: Level
    code: str
    text: str


class Subject(StrEnum):
    """Subject of a task."""

    PRELOAD = "preload"
    GREASE = "grease"
    MODEL = "model"
    MOTION = "motion"
    DATA = "data"
    ALARM = "alarm"


class Task(StrEnum):
    """Task for a person; the codes never change."""

    INSPECT = "inspect"
    REPLACE_NUT = "replace_nut"
    CONFIRM_LOSS = "confirm_loss"
    PLAN_NUT = "plan_nut"
    FIND_WEAR = "find_wear"
    DIAGNOSE = "diagnose"
    REGREASE = "regrease"
    FIND_CHANGE = "find_change"
    CHECK_SERVICE = "check_service"
    CHECK_CONNECTION = "check_connection"
    SWITCH_ON = "switch_on"
    COMPLETE_MACHINE_FILE = "complete_machine_file"
    COMMISSION_SOURCE = "commission_source"
    MOVE_FREELY = "move_freely"
    MOVE = "move"
    WAIT = "wait"
    ACKNOWLEDGE = "acknowledge"


class Due(Frozen):
    """Time by which a task is due: the interval in which its limit is reached.

    Attributes:
        earliest_ns, likely_ns, latest_ns: UNIX times, ns; None beyond what the history can tell.
    """

    earliest_ns: int
    likely_ns: int | None = None
    latest_ns: int | None = None


class Advice(Frozen):
    """One task.

    Attributes:
        text: the task in words.
        now: whether it is due now.
        due: when else; None where no date can be named.
        together_with: what else to do in the same stop.
    """

    task: Task
    subject: Subject
    text: str
    now: bool
    due: Due | None = None
    together_with: tuple[Task, ...] = ()


class PreloadFall(Frozen):
    """Sudden fall of the preload, remembered until a part is replaced.

    Attributes:
        from_percent, to_percent: percent of the fresh screw's preload.
        time_ns: UNIX time, ns.
    """

    from_percent: float
    to_percent: float
    time_ns: int
