"""Whole plant from the answers of its fleet nodes: rows, and what part of it is missing. Pure."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from ...messages.fleet import KnownMachine, RowsAnswer
from ...messages.health import AxisCondition
from ...messages.plant import BUCKETS, AxisReport, MachineReport, PlantKeys
from .rows import FleetRow, compared

_LAST_S = 253_402_300_799.0
"""End of the year 9999, UNIX s."""


@dataclass(frozen=True, slots=True)
class FleetNodeState:
    """One fleet node: whether it answers, and how many parts of the plant it reads."""

    name: str
    answered: bool
    page: str = ""
    parts: int = 0
    machines: int = 0
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class PlantTable:
    """All axes of a plant, the worst first.

    Attributes:
        missing: what is not shown as it is now, a sentence each; empty if nothing is missing.
        machines: how many there are.
        lost: reports that never arrived.
    """

    rows: tuple[FleetRow, ...]
    nodes: tuple[FleetNodeState, ...]
    missing: tuple[str, ...]
    machines: int = 0
    lost: int = 0


def plant_table(answers: Sequence[RowsAnswer], nodes: Collection[str]) -> PlantTable:
    """Table of the whole plant.

    Args:
        answers: of the fleet nodes, one each.
        nodes: names of those that are there; whoever is silent is named.
    """
    machines = merged(answers)
    rows = [row for machine in machines for row in rows_of_machine(machine)]
    states = node_states(answers, nodes)
    missing = missing_of(answers, states)
    lost = sum(machine.lost for machine in machines)
    return PlantTable(tuple(compared(rows)), states, missing, len(machines), lost)


def merged(answers: Sequence[RowsAnswer]) -> list[KnownMachine]:
    """Each machine once: as the node says that reads it, else as who has heard of it last."""
    best: dict[tuple[str, str], tuple[tuple[bool, bool, int], KnownMachine]] = {}
    removed: dict[tuple[str, str], int] = {}
    for answer in answers:
        owned = frozenset(answer.buckets)
        for machine in answer.machines:
            name = machine.name
            removed[name] = max(removed.get(name, 0), machine.removed_ns)
            known = machine.report is not None
            rank = (known and PlantKeys(*name).bucket in owned, known, machine.heard_ns)
            if name not in best or rank > best[name][0]:
                best[name] = rank, machine
    return [each for name, (_, each) in best.items() if each.heard_ns > removed[name]]


def node_states(
    answers: Sequence[RowsAnswer], nodes: Collection[str]
) -> tuple[FleetNodeState, ...]:
    """Every fleet node that is there or has answered, by name."""
    by_name = {answer.node: answer for answer in answers}
    silent = [FleetNodeState(name, answered=False) for name in {*nodes} - {*by_name}]
    heard = [_state(answer, answers) for answer in by_name.values()]
    return tuple(sorted((*silent, *heard), key=lambda state: state.name))


def _state(answer: RowsAnswer, answers: Sequence[RowsAnswer]) -> FleetNodeState:
    read = sum(machine.report is not None for machine in answer.machines)
    problems = _problems(answer, answers)
    return FleetNodeState(answer.node, True, answer.page, len(answer.buckets), read, problems)


def _problems(answer: RowsAnswer, answers: Sequence[RowsAnswer]) -> tuple[str, ...]:
    twins = {each.instance for each in answers if each.node == answer.node}
    double = ("another fleet node has the same name",) if len(twins) > 1 else ()
    return (*answer.problems, *double)


def missing_of(answers: Sequence[RowsAnswer], states: Sequence[FleetNodeState]) -> tuple[str, ...]:
    """Sentences on what part of the plant is not shown as it is now."""
    silent = [state.name for state in states if not state.answered]
    read = {bucket for answer in answers for bucket in answer.buckets}
    said = [f"the fleet node {name} does not answer" for name in silent]
    if len(read) < BUCKETS:
        said.append(
            f"part of the plant is not shown: {BUCKETS - len(read)} of its {BUCKETS} parts "
            "are read by no fleet node that answers"
        )
    return tuple(said)


def rows_of_machine(machine: KnownMachine) -> list[FleetRow]:
    """Rows of one machine; what is not current shows no number."""
    report = machine.report
    if report is not None and machine.current:
        return [_row(report, axis, machine.silent_s) for axis in report.axes]
    was = {} if report is None else {axis.axis: axis.condition for axis in report.axes}
    return [
        FleetRow(
            "" if report is None else report.page,
            machine.site,
            machine.machine,
            axis,
            AxisCondition.UNAVAILABLE,
            reason=f"not heard since {moment(machine.heard_ns)}{_then(was.get(axis))}",
            version="" if report is None else report.version,
        )
        for axis in machine.axes
    ]


def _then(condition: AxisCondition | None) -> str:
    """Condition at that time, where somebody should know of it."""
    grave = condition in (AxisCondition.FAULT, AxisCondition.WARNING)
    return f"; it was {condition} then" if grave else ""


def _row(report: MachineReport, axis: AxisReport, silent_s: float) -> FleetRow:
    loss, fresh, percent = axis.loss_per_1000_h, axis.fresh_percent, axis.preload_percent
    return FleetRow(
        address=report.page,
        site=report.site,
        machine=report.machine,
        axis=axis.axis,
        condition=axis.condition,
        preload_percent=percent,
        low=axis.low,
        high=axis.high,
        share_percent=None if percent is None or not fresh else 100.0 * percent / fresh,
        age_s=_age_s(report, axis, silent_s),
        fits=axis.fits,
        limit=axis.limit,
        limit_earliest=_moment_or_none(axis.limit_earliest_ns),
        limit_latest=_moment_or_none(axis.limit_latest_ns),
        loss_percent_per_1000_h=None if loss is None else (loss.value, loss.low, loss.high),
        reason=axis.reason,
        headline="" if axis.headline is None else axis.headline.text,
        task=axis.task,
        version=report.version,
    )


def _age_s(report: MachineReport, axis: AxisReport, silent_s: float) -> float | None:
    """Age of the newest sample: by the machine's clock until it reported, by ours since then, s."""
    if axis.time_ns is None:
        return None
    return max(report.time_ns - axis.time_ns, 0) / 1e9 + silent_s


def _moment_or_none(time_ns: int | None) -> str | None:
    return None if time_ns is None else moment(time_ns)


def moment(time_ns: int) -> str:
    """UNIX time in ns as RFC 3339."""
    time = datetime.fromtimestamp(min(max(time_ns / 1e9, 0.0), _LAST_S), UTC)
    return time.isoformat(timespec="milliseconds").replace("+00:00", "Z")
