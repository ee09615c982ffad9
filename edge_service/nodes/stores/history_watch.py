"""Report on the history: its component, its counts, and events of what it could not keep."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from ...clock import now_ns
from ...messages.event import Event, Severity
from ...messages.health import ComponentStatus

log = logging.getLogger(__name__)
Report = Callable[[ComponentStatus, str], None]
Tell = Callable[[Event], None]


@dataclass(slots=True)
class Turn:
    """Outcome of one turn of keeping the history.

    Attributes:
        problems: why something could not be kept or read; it is tried again.
        damages: axis and sentence for each damaged file.
        lost: estimates that found no place since the start.
        adopted: files of an earlier version that were given a checksum since the start.
        future: by axis, files that are dated after now; None: not looked at.
    """

    problems: list[str] = field(default_factory=list)
    damages: list[tuple[str, str]] = field(default_factory=list)
    lost: int = 0
    adopted: int = 0
    future: dict[str, list[str]] | None = None


class HistoryWatch:
    """Tells people and programs how the history fares, in the thread of the event loop.

    Args:
        report: takes the status of the component `history`, with the reason.
        tell: takes events.
    """

    def __init__(self, report: Report, tell: Tell) -> None:
        self._report = report
        self._tell = tell
        self._problem = ""
        self._damage = ""
        self._future: dict[str, int] = {}
        self._counts = dict.fromkeys(("damages", "failed_turns", "lost_estimates", "adopted"), 0)

    def counts(self) -> dict[str, int]:
        """Counts since the start."""
        return dict(self._counts)

    def readings(self) -> dict[str, float]:
        """Files now that are dated after now."""
        return {"future_files": float(sum(self._future.values()))}

    def take(self, turn: Turn) -> None:
        """Say what changed."""
        self._counts["lost_estimates"], self._counts["adopted"] = turn.lost, turn.adopted
        for axis, words in turn.damages:
            self._on_damage(axis, words)
        if turn.future is not None:
            self._on_future(turn.future)
        self._on_problems(turn.problems)

    def _on_damage(self, axis: str, words: str) -> None:
        self._counts["damages"] += 1
        self._damage = f"damage: {words}"
        log.warning("axis %s: history damaged: %s", axis, words)
        self._event(axis, "history_damaged", Severity.WARNING, f"history damaged: {words}")

    def _on_future(self, future: dict[str, list[str]]) -> None:
        for axis, names in future.items():
            if len(names) > self._future.get(axis, 0):
                words = (
                    f"{len(names)} files of the history are dated after now, such as {names[-1]}: "
                    "the clock was wrong when they were written; they are the first to make room"
                )
                log.warning("axis %s: %s", axis, words)
                self._event(axis, "history_from_future", Severity.WARNING, words)
            self._future[axis] = len(names)

    def _on_problems(self, problems: Sequence[str]) -> None:
        problem, before = problems[0] if problems else "", self._problem
        self._counts["failed_turns"] += bool(problem)
        self._problem = problem
        if problem and not before:
            log.warning("history cannot be kept: %s", problem)
            words = f"history cannot be kept, and is in memory until it can: {problem}"
            self._event("", "history_failing", Severity.ERROR, words)
        elif before and not problem:
            log.info("history is kept again")
            self._event("", "history_kept", Severity.INFO, "history is kept again")
        status = ComponentStatus.RECOVERABLE_ERROR if problem else ComponentStatus.OK
        self._report(status, problem or self._damage)

    def _event(self, axis: str, kind: str, severity: Severity, words: str) -> None:
        event = Event(axis=axis, kind=kind, severity=severity, message=words, time_ns=now_ns())
        self._tell(event)
