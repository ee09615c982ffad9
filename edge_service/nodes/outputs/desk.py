"""Outputs of one service: every event is offered to each, and their dead letters are kept here."""

import json
from collections.abc import AsyncIterator, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from typing import Any

from ...bus.spool.message import DeadLetter
from ...bus.spool.spool import Spool
from ...health.store.events import EventLog, StoredEvent
from ...http_api.jobs import RefusedError
from ...http_api.outputs import DeadLetterAnswer
from ..wiring.context import NodeContext
from .ordered import Answers, OrderedOutput
from .registry import OPENERS
from .report import OutputReport

MOST_MISSED = 10_000
"""Events that an output may have missed while the service was down."""


class OutputDesk:
    """The outputs as configured."""

    def __init__(self, spools: Mapping[str, Spool]) -> None:
        self._spools = spools
        self._outputs: dict[str, tuple[OrderedOutput, OutputReport]] = {}

    @classmethod
    async def open(
        cls, context: NodeContext, answers: Answers = lambda _axis: None
    ) -> "OutputDesk":
        """Open what is configured. Raises ConfigError.

        Args:
            answers: what holds now of an axis.
        """
        desk = cls(context.spools)
        for name, make in OPENERS.items():
            report = OutputReport(context, name)
            output = await make(context.config, report.tell, answers)
            if output is not None:
                report.watch(output.spool, partial(_counters, output))
                report.tell("")
                desk._outputs[name] = output, report
                await _catch_up(output, context.events)
        return desk

    def put(self, logged: StoredEvent) -> None:
        """Offer an event to all."""
        for output, _ in self._outputs.values():
            output.put(logged)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Let the outputs send inside."""
        async with AsyncExitStack() as stack:
            for output, report in self._outputs.values():
                tasks = await stack.enter_async_context(report.running())
                tasks.start("delivery", output.run)
            yield

    async def dead_letters(self, name: str) -> list[DeadLetterAnswer]:
        """Dead letters of an output, the oldest first; none of one in another process."""
        spool = self._spool(name)
        return [] if spool is None else [_shown(letter) for letter in await spool.letters()]

    async def revive(self, name: str, key: str) -> None:
        """Try a dead letter again, after all that waits. Raises RefusedError."""
        _found(name, key, await self._known(name).revive(key))

    async def revive_all(self, name: str) -> None:
        """Try all dead letters of an output again, in their order. Raises RefusedError."""
        spool = self._known(name)
        for letter in await spool.letters():
            await spool.revive(letter.key)

    async def forget(self, name: str, key: str) -> None:
        """Drop a dead letter. Raises RefusedError."""
        _found(name, key, await self._known(name).forget(key))

    def close(self) -> None:
        """Close the files; safe twice."""
        for output, _ in self._outputs.values():
            output.spool.close()

    def _spool(self, name: str) -> Spool | None:
        return self._outputs[name][0].spool if name in self._outputs else self._spools.get(name)

    def _known(self, name: str) -> Spool:
        spool = self._spool(name)
        if spool is None:
            raise RefusedError(404, f"this service has no output {name!r} that keeps dead letters")
        return spool


async def _catch_up(output: OrderedOutput, diary: EventLog) -> None:
    """Offer an output what came into the diary and, as the service ended then, not to the output.

    A new output begins with the events to come.
    """
    if output.spool.mark:
        for logged in diary.after(output.spool.mark, MOST_MISSED):
            output.put(logged)
    await output.spool.set_mark(diary.last_id())


def _counters(output: OrderedOutput) -> dict[str, int]:
    return {"delivered": output.delivered}


def _found(name: str, key: str, found: bool) -> None:
    if not found:
        raise RefusedError(404, f"{name}: there is no dead letter {key!r}")


def _shown(letter: DeadLetter) -> DeadLetterAnswer:
    axis, _, topic = letter.topic.partition("/")
    event: dict[str, Any] = json.loads(letter.payload or "{}")
    return DeadLetterAnswer(
        id=letter.key,
        axis=axis,
        kind=event.get("kind", topic),
        message=event.get("message", topic),
        time=event.get("time_ns", event.get("source_time_ns", letter.time_ns)),
        tries=letter.tries,
        reason=letter.reason,
        dead_since=letter.time_ns,
    )
