"""Backfill: the past of the machines of a fleet node, fetched from their own logs and kept."""

import asyncio
import logging
from collections.abc import Callable
from pathlib import Path

from pydantic import ValidationError

from ...bus.plant.fleet import packed
from ...bus.questions import ask
from ...clock import now_ns, steady_ns
from ...health.fleet.backfill import Caught, caught, question_for
from ...health.fleet.machines import Machine
from ...kept_database import DatabaseFailedError
from ...messages.fleet import HistoryAnswer, HistoryQuestion, KnownMachine
from ...messages.plant import LogAnswer, LogQuestion, LogState, PlantKeys
from ...threads import Threads
from ..stores.fleet_store import FILE, FleetStore
from ..supervision.heartbeat import Heartbeat
from .reader import FleetReader

log = logging.getLogger(__name__)
PERIOD_S = 0.5
KNOW_PERIOD_S = 10.0
TOGETHER = 16
"""Logs that are asked at once."""
ANSWER_S = 3.0
MOST_ANSWER_BYTES = 4_000_000
REST_NS = 10_000_000_000
"""Time for which a log that has not answered, or not to the point, is left alone, ns."""
_DISK_S = 60.0


class Backfill:
    """Keeper of the past of a fleet node's machines, and of the list of all that are known.

    Args:
        folder: None keeps nothing: then the list lives in memory, and no log is asked.
    """

    def __init__(self, reader: FleetReader, folder: Path | None, budget_mb: float) -> None:
        self._reader = reader
        self._store = None if folder is None else FleetStore(folder / FILE, budget_mb * 1e6)
        self._thread = Threads("fleet store", 1)
        self._resting: dict[tuple[str, str], int] = {}
        self._kept: dict[tuple[str, str], KnownMachine] = {}
        self.problem = ""
        """Reason for which the disk takes nothing now; empty if it does."""
        self.counts = dict.fromkeys(("log_questions", "log_silent", "log_reports", "log_lost"), 0)

    def problems(self) -> list[str]:
        """Problems, in words."""
        return [self.problem] if self.problem else []

    async def run(self, heart: Heartbeat) -> None:
        """Catch up with every log, for ever; a failing disk is tried again."""
        if self._store is None:
            with heart.idle():
                await asyncio.Event().wait()
            return
        await self._remember(heart, self._store)
        known_ns = 0
        while True:
            more = await self._catch_up(heart, self._store)
            if steady_ns() - known_ns >= KNOW_PERIOD_S * 1e9:
                known_ns = steady_ns()
                await self._know(heart, self._store)
            await heart.sleep(0.0 if more else PERIOD_S)

    async def past(self, question: HistoryQuestion) -> HistoryAnswer:
        """Kept past of one axis in this node's store. Raises DatabaseFailedError."""
        name = self._reader.name
        if self._store is None:
            return HistoryAnswer(node=name)
        points, holes = await self._thread.run(self._store.past, question)
        return HistoryAnswer(node=name, points=tuple(points), holes=tuple(holes))

    def answer(self, _key: str, question: bytes, reply: Callable[[bytes | None], None]) -> None:
        """Answer another fleet node's question for the past; None if it cannot be meant."""
        try:
            asked = HistoryQuestion.model_validate_json(question)
        except ValidationError:
            reply(None)
            return
        answering = asyncio.ensure_future(self._packed(asked))

        def on_done(done: "asyncio.Future[bytes | None]") -> None:
            reply(None if done.cancelled() or done.exception() else done.result())

        answering.add_done_callback(on_done)

    async def _packed(self, question: HistoryQuestion) -> bytes | None:
        try:
            return packed(await self.past(question))
        except DatabaseFailedError:
            return None

    def close(self) -> None:
        """Close the store; safe twice."""
        if self._store is not None:
            self._store.close()

    async def _remember(self, heart: Heartbeat, store: FleetStore) -> None:
        """Take in what was known before this process."""
        while True:
            try:
                known = await heart.patiently(self._thread.run(store.known), limit_s=_DISK_S)
                self._reader.machines.learn(known)
                self._note(store)
                return
            except DatabaseFailedError as error:
                self._failed(error)
                await heart.sleep(1.0)

    async def _catch_up(self, heart: Heartbeat, store: FleetStore) -> bool:
        """Ask some logs, and keep what they answer; tells whether more is to be had."""
        waiting = self._waiting()
        if not waiting:
            return False
        now = waiting[:TOGETHER]
        answers = await heart.patiently(
            asyncio.gather(*(self._ask(machine, question) for machine, question in now))
        )
        found: list[tuple[KnownMachine, Caught]] = []
        for (machine, _), more in zip(now, answers, strict=True):
            if more is None:
                self.counts["log_silent"] += 1
                self._resting[machine.name] = steady_ns() + REST_NS
            else:
                found.append((machine.told(now_ns()), more))
        if found and await self._keep(heart, store, found):
            for known, more in found:
                self._reader.machines.advance(known.name, more.cursor)
                self.counts["log_reports"] += len(more.reports)
                self.counts["log_lost"] += sum(each.last - each.first + 1 for each in more.holes)
        return bool(found) and not self.problem

    def _waiting(self) -> list[tuple[Machine, LogQuestion]]:
        """Machines of this node with reports that are not kept, and what to ask them."""
        reader, at_ns, waiting = self._reader, steady_ns(), []
        for machine in reader.machines:
            report = machine.report
            if report is None or report.log is None or not machine.present:
                continue
            if self._resting.get(machine.name, 0) > at_ns:
                continue
            question = question_for(report.log, machine.cursor)
            if question and PlantKeys(*machine.name).bucket in reader.buckets:
                waiting.append((machine, question))
        return waiting

    async def _ask(self, machine: Machine, question: LogQuestion) -> Caught | None:
        session, report = self._reader.session, machine.report
        if session is None or report is None or report.log is None:
            return None
        self.counts["log_questions"] += 1
        asked = question.model_dump_json().encode()
        said = await ask(session.zenoh, PlantKeys(*machine.name).log, asked, ANSWER_S)
        if said is None or len(said) > MOST_ANSWER_BYTES:
            return None
        return await self._thread.run(_read, said, report.log, machine)

    async def _keep(
        self, heart: Heartbeat, store: FleetStore, found: list[tuple[KnownMachine, Caught]]
    ) -> bool:
        try:
            await heart.patiently(self._thread.run(store.keep, found), limit_s=_DISK_S)
        except DatabaseFailedError as error:
            self._failed(error)
            await heart.sleep(1.0)
            return False
        self.problem = ""
        return True

    async def _know(self, heart: Heartbeat, store: FleetStore) -> None:
        """Keep the list of machines where it has changed, but for times of less than a minute."""
        known = {each.name: _brief(each) for each in self._reader.machines.told(now_ns())}
        changed = [each for name, each in known.items() if each != self._kept.get(name)]
        try:
            if changed:
                await heart.patiently(self._thread.run(store.know, changed), limit_s=_DISK_S)
            await heart.patiently(self._thread.run(store.copy, now_ns() / 1e9), limit_s=_DISK_S)
        except DatabaseFailedError as error:
            self._failed(error)
            return
        self._kept |= {each.name: each for each in changed}
        self._note(store)
        self.problem = ""

    def _failed(self, error: Exception) -> None:
        if not self.problem:
            log.error("the history cannot be kept now: %s", error)
        self.problem = f"the history cannot be kept now: {error}"

    def _note(self, store: FleetStore) -> None:
        """Log what the store has found damaged."""
        damages = store.damages()
        for line in damages:
            log.warning("%s", line)
        damages.clear()


def _read(said: bytes, log: LogState, machine: Machine) -> Caught | None:
    """Read an answer of a log; for hundreds of reports that takes a while."""
    try:
        answer = LogAnswer.model_validate_json(said)
    except ValidationError:
        return None
    return caught(answer, log, machine.cursor, *machine.name)


def _brief(machine: KnownMachine) -> KnownMachine:
    """Part of a machine that is kept in the list; its time by the minute."""
    minute_ns = 60_000_000_000
    return KnownMachine(
        site=machine.site,
        machine=machine.machine,
        axes=machine.axes,
        heard_ns=machine.heard_ns // minute_ns * minute_ns,
        removed_ns=machine.removed_ns,
    )
