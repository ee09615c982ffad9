"""Machines of a plant as one fleet node knows them. Pure: times are given."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, replace

from ...messages.fleet import Cursor, KnownMachine
from ...messages.plant import MachineReport, PlantKeys

SILENT_PERIODS, LEAST_SILENCE_S = 5.0, 2.0
"""Periods of its reports, and time, after which a machine that is not heard is not current."""
MOST_MACHINES = 20_000
Name = tuple[str, str]
"""Site and machine."""


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine: what is kept of it, and what is heard now.

    Attributes:
        axes: names of its axes as last reported.
        heard_ns: UNIX time of the last report's arrival, ns; 0 before the first.
        present: whether its publisher is there.
        report: None unless this node reads it.
    """

    name: Name
    axes: tuple[str, ...] = ()
    heard_ns: int = 0
    present: bool = False
    report: MachineReport | None = None
    lost: int = 0
    restarts: int = 0
    cursor: Cursor | None = None
    removed_ns: int = 0

    def is_current(self, now_ns: int) -> bool:
        """Tell whether the last report still says how the machine is."""
        if self.report is None or not self.present:
            return False
        silence_s = max(SILENT_PERIODS * self.report.period_s, LEAST_SILENCE_S)
        return now_ns - self.heard_ns <= silence_s * 1e9

    def told(self, now_ns: int) -> KnownMachine:
        """The same for other nodes."""
        return KnownMachine(
            site=self.name[0],
            machine=self.name[1],
            axes=self.axes,
            heard_ns=self.heard_ns,
            silent_s=0.0 if self.report is None else max(now_ns - self.heard_ns, 0) / 1e9,
            current=self.is_current(now_ns),
            report=self.report,
            lost=self.lost,
            restarts=self.restarts,
            cursor=self.cursor,
            removed_ns=self.removed_ns,
        )


class FleetMachines:
    """Machines that were ever known, until somebody removes them.

    Args:
        most: machines that are known at most; further ones are not taken in.
    """

    def __init__(self, most: int = MOST_MACHINES) -> None:
        self._machines: dict[Name, Machine] = {}
        self._most = most
        self.refused = 0
        """Reports of machines beyond that number."""

    def __len__(self) -> int:
        return len(self._machines)

    def __iter__(self) -> Iterator[Machine]:
        return iter(tuple(self._machines.values()))

    def get(self, name: Name) -> Machine | None:
        """One machine; None if it is not known."""
        return self._machines.get(name)

    def on_report(self, report: MachineReport, now_ns: int, lost: int, restarts: int) -> None:
        """Take in a report; whoever reports is present."""
        machine = self._of((report.site, report.machine))
        if machine is None:
            self.refused += 1
            return
        axes = tuple(axis.axis for axis in report.axes)
        self._put(
            replace(
                machine,
                axes=axes,
                heard_ns=now_ns,
                present=True,
                report=report,
                lost=lost,
                restarts=restarts,
            )
        )

    def on_presence(self, name: Name, present: bool) -> None:
        """Take in that the publisher of a machine has come or gone."""
        machine = self._machines.get(name)
        if machine is not None:
            self._put(replace(machine, present=present))

    def keep(self, buckets: Collection[int], now_ns: int) -> None:
        """Forget old reports of machines in parts of the plant that others read now."""
        for machine in self:
            elsewhere = PlantKeys(*machine.name).bucket not in buckets
            if machine.report is not None and elsewhere and not machine.is_current(now_ns):
                self._put(replace(machine, report=None, present=False))

    def learn(self, known: Iterable[KnownMachine]) -> None:
        """Take in what another node, or the disk, knows: newer times and further cursors win."""
        for other in known:
            machine = self._of(other.name)
            if machine is None:
                continue
            newer = other.heard_ns > machine.heard_ns and machine.report is None
            self._put(
                replace(
                    machine,
                    axes=other.axes if newer or not machine.axes else machine.axes,
                    heard_ns=max(other.heard_ns, machine.heard_ns),
                    cursor=_further(machine, other),
                    removed_ns=max(other.removed_ns, machine.removed_ns),
                )
            )

    def advance(self, name: Name, cursor: Cursor) -> None:
        """Note up to where the log of a machine is kept."""
        machine = self._machines.get(name)
        if machine is not None:
            self._put(replace(machine, cursor=cursor))

    def remove(self, name: Name, now_ns: int) -> bool:
        """Take a machine out of the list until it is heard again; False if it is not known."""
        machine = self._machines.get(name)
        if machine is None:
            return False
        self._put(replace(machine, removed_ns=now_ns))
        return True

    def told(self, now_ns: int) -> tuple[KnownMachine, ...]:
        """All of them, for other nodes."""
        return tuple(machine.told(now_ns) for machine in self)

    def _of(self, name: Name) -> Machine | None:
        known = self._machines.get(name)
        if known is None and len(self._machines) < self._most:
            return Machine(name)
        return known

    def _put(self, machine: Machine) -> None:
        self._machines[machine.name] = machine


def _further(machine: Machine, other: KnownMachine) -> Cursor | None:
    """Cursor of the two that is further, where they are of one log; else that heard of later."""
    mine, its = machine.cursor, other.cursor
    if mine is None or its is None:
        return mine or its
    if mine.log == its.log:
        return mine if mine.number >= its.number else its
    return its if machine.report is None and other.heard_ns > machine.heard_ns else mine
