"""Catching up with the log of a machine: what to ask for, and what an answer is worth. Pure."""

from dataclasses import dataclass

from ...messages.fleet import Cursor, Hole
from ...messages.plant import LogAnswer, LoggedReport, LogQuestion, LogState

MOST_REPORTS = 200
"""Reports that one question asks for."""


@dataclass(frozen=True, slots=True)
class Caught:
    """Reports that follow what is kept, in order, and what of the log is gone for good."""

    cursor: Cursor
    reports: tuple[LoggedReport, ...]
    holes: tuple[Hole, ...]


def question_for(log: LogState, cursor: Cursor | None) -> LogQuestion | None:
    """Question for the reports of a log that are not kept; None if all are."""
    after = _after(log, cursor)
    if after >= log.last:
        return None
    return LogQuestion(log=log.log, after=after, most=MOST_REPORTS)


def caught(
    answer: LogAnswer, log: LogState, cursor: Cursor | None, site: str, machine: str
) -> Caught | None:
    """Gain by an answer; None if there is none, or it cannot be believed.

    Numbers that are missing before or between its reports are gone: the log has lost its oldest, or
    found some of them damaged.
    """
    if answer.log != log.log or not answer.reports:
        return None
    last = _after(log, cursor)
    holes = [] if cursor is None or cursor.log != log.log else _hole(log.log, cursor.number, last)
    for each in answer.reports[:MOST_REPORTS]:
        of_machine = (each.report.site, each.report.machine) == (site, machine)
        if each.number <= last or not of_machine:
            return None
        holes += _hole(log.log, last, each.number - 1)
        last = each.number
    reports = answer.reports[:MOST_REPORTS]
    return Caught(Cursor(log=log.log, number=last), reports, _joined(holes))


def _after(log: LogState, cursor: Cursor | None) -> int:
    """Number after which reports are to be had and not kept."""
    if cursor is None or cursor.log != log.log:
        return max(log.first - 1, 0)
    return max(cursor.number, log.first - 1)


def _hole(log: str, after: int, until: int) -> list[Hole]:
    return [Hole(log=log, first=after + 1, last=until)] if until > after else []


def _joined(holes: list[Hole]) -> tuple[Hole, ...]:
    """Holes that touch as one."""
    joined: list[Hole] = []
    for hole in holes:
        if joined and joined[-1].last + 1 == hole.first:
            joined[-1] = joined[-1].model_copy(update={"last": hole.last})
        else:
            joined.append(hole)
    return tuple(joined)
