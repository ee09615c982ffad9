"""Commands as questions on the bus: who gives one learns what came of it, once it is kept."""

import time
from collections.abc import Callable, Collection

from ...bus.questions import Answering
from ...clock import now_ns
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


def _header() -> Header:
    """Header of a question or an answer: each is the only one of its series."""
    asked_ns = now_ns()
    return Header(0, asked_ns, asked_ns, time.monotonic_ns())
