"""Commands as questions on the bus: who gives one learns what came of it, once it is kept."""

import secrets
import time
from collections.abc import Callable, Collection

from ...bus.questions import Answering
from ...clock import now_ns
from ...health.events.audit import BEGUN, AuditEntry
from ...messages.alarm import Command, Outcome
from ...messages.codec.interface import CodecError
from ...messages.header import Header
from ...messages.topics import COMMAND, OUTCOME
from .context import NodeContext

ANSWER_S = 5.0
"""So long a command may take."""
Obey = Callable[[str, Command, Callable[[Outcome], None]], None]
"""Does what a command on an axis asks, and tells the outcome later."""


async def give(context: NodeContext, axis: str, command: Command) -> Outcome | None:
    """Give a command to whoever monitors the axis; None if nobody answers."""
    question = COMMAND.encode(axis, _header(), command)
    answer = await context.bus.ask(context.config.keys.key(axis, OUTCOME), question, ANSWER_S)
    try:
        return None if answer is None else OUTCOME.decode(answer)[2]
    except CodecError:
        return None


def obey_all(context: NodeContext, axes: Collection[str], obey: Obey) -> Answering:
    """Answer the commands on axes, until it is closed."""

    keys = context.config.keys

    def answer(key: str, question: bytes, reply: Callable[[bytes | None], None]) -> None:
        try:
            axis, _, command = COMMAND.decode(question)
        except CodecError:
            reply(None)
            return
        if axis not in axes or key != keys.key(axis, OUTCOME):
            reply(None)
            return
        obey(axis, command, lambda told: reply(OUTCOME.encode(axis, _header(), told)))

    return context.bus.answer(keys.all_axes(OUTCOME), answer)


class NotedCommand:
    """Entries of the audit log about one command; none where the service itself asks."""

    def __init__(self, axis: str, command: Command, now_ns: int) -> None:
        self._entry = AuditEntry(
            time_ns=now_ns,
            who=command.user,
            origin=command.origin or "bus",
            action=command.action,
            target=axis if command.alarm is None else f"{axis} {command.alarm}",
            data={"request": secrets.token_hex(6)}
            | ({"note": command.note} if command.note else {})
            | ({"key": command.key} if command.key else {}),
        )
        self._is_noted = command.action != "recorded"

    def intent(self) -> tuple[AuditEntry, ...]:
        """Entry from before it is done."""
        return self._with(BEGUN)

    def outcome(self, outcome: Outcome) -> tuple[AuditEntry, ...]:
        """Entry of what came of it."""
        return self._with("done" if outcome.accepted else f"refused: {outcome.message}")

    def _with(self, outcome: str) -> tuple[AuditEntry, ...]:
        return (self._entry.model_copy(update={"outcome": outcome}),) if self._is_noted else ()


def _header() -> Header:
    """Header of a question or an answer: each is the only one of its series."""
    asked_ns = now_ns()
    return Header(0, asked_ns, asked_ns, time.monotonic_ns())
