"""Words between the fleet nodes of a plant: the machines that each knows, and their history."""

from .health import AxisCondition
from .plant import MachineReport, Reported

ROWS, HISTORY = "rows", "history"
"""Questions that every fleet node answers."""


class Cursor(Reported):
    """Place in a machine's log up to which its reports are kept."""

    log: str
    number: int


class KnownMachine(Reported):
    """One machine as a fleet node knows it.

    Attributes:
        axes: names of its axes, also where there is no report.
        heard_ns: UNIX time of the last report's arrival, ns; 0 before the first.
        silent_s: time since then when this was told, on the clock of the node that tells, s.
        current: whether its last report tells how it is now.
        report: the last one; None from a node that does not read the machine.
        lost, restarts: reports that never arrived, by holes in their numbers; its starts.
        cursor: None before anything of its log is kept.
        removed_ns: UNIX time at which somebody took it out of the list, ns; 0 if nobody has.
    """

    site: str
    machine: str
    axes: tuple[str, ...] = ()
    heard_ns: int = 0
    silent_s: float = 0.0
    current: bool = False
    report: MachineReport | None = None
    lost: int = 0
    restarts: int = 0
    cursor: Cursor | None = None
    removed_ns: int = 0

    @property
    def name(self) -> tuple[str, str]:
        """Site and machine."""
        return self.site, self.machine


class RowsAnswer(Reported):
    """All that one fleet node knows of the plant.

    Attributes:
        node: its name.
        instance: of the process, to tell two of one name apart.
        page: address of its page; empty if others cannot reach it.
        time_ns: UNIX time of the answer, ns.
        buckets: parts of the plant that it reads.
        problems: what is wrong with it, in words.
    """

    node: str
    instance: str
    page: str = ""
    time_ns: int
    buckets: tuple[int, ...] = ()
    machines: tuple[KnownMachine, ...] = ()
    problems: tuple[str, ...] = ()


class HistoryQuestion(Reported):
    """Question for the kept past of one axis: the newest points from a time on, UNIX ns."""

    site: str
    machine: str
    axis: str
    since_ns: int = 0
    most: int = 2000


class HistoryPoint(Reported):
    """Axis as one report of the machine's log says it was.

    Attributes:
        log, number: of the report; a point is the same wherever it is kept.
        time_ns: UNIX time of the report, ns.
        fresh_percent: the fresh screw's preload, percent of the load rating.
    """

    log: str
    number: int
    time_ns: int
    condition: AxisCondition
    preload_percent: float | None = None
    low: float | None = None
    high: float | None = None
    fresh_percent: float | None = None


class Hole(Reported):
    """Reports of a log that nobody has any more, first and last."""

    log: str
    first: int
    last: int


class HistoryAnswer(Reported):
    """The kept past of one axis, the oldest first."""

    node: str
    points: tuple[HistoryPoint, ...] = ()
    holes: tuple[Hole, ...] = ()
