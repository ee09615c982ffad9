"""Something that happened and that people or programs may want to hear of."""

from enum import StrEnum

from .estimate import Frozen


class Severity(StrEnum):
    """Level of attention that an event asks for."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


class Event(Frozen):
    """One event of one axis (or of the service, with an empty axis).

    Attributes:
        kind: e.g. `condition_changed`, `status_changed`, `component_changed`, `data_fault`.
        time_ns: UNIX time in ns.
        data: the values that changed.
    """

    axis: str
    kind: str
    severity: Severity
    message: str
    time_ns: int
    data: dict[str, str | float | int | None] = {}
