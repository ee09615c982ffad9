"""Part of the plant that a fleet node reads: the share that is its own of those that are there."""

import asyncio
import logging
import secrets
from collections import Counter
from collections.abc import Callable

from ...bus.plant.fleet import FleetMembers, answer_packed, ask_all, ask_rows, packed, present_nodes
from ...bus.plant.reports import Heard, PlantReports
from ...bus.plant.session import PlantAwayError, PlantSession, PlantSettings
from ...bus.questions import Answer, Answering
from ...clock import now_ns, steady_ns
from ...health.fleet.machines import FleetMachines
from ...health.fleet.ownership import owned_by
from ...messages.fleet import HISTORY, ROWS, HistoryAnswer, HistoryQuestion, RowsAnswer
from ...threads import Threads
from ..supervision.failures import Failures
from ..supervision.heartbeat import Heartbeat

log = logging.getLogger(__name__)
JOIN_PERIOD_S = 1.0
GATHER_S = 0.1
"""Time in which further nodes may come or go before the plant is divided anew."""
ASK_S = 1.0
SILENT_NS = 5_000_000_000
"""Time for which the last answer of a fleet node that is there stands, ns."""
_ASKED_NS, _READY_NS = 3_000_000_000, 2_500_000_000
"""Time after a question for which answers are made ahead; age up to which one is given."""
_LIMIT_S = 30.0
_ENCODER = Threads("fleet answers", 1)


class FleetReader:
    """Reads one fleet node's share of the plant, and tells the other nodes of it.

    Args:
        name: of the fleet node.
        page: address of its page; empty without one.
        problems: what else is wrong with the node, in words.
    """

    def __init__(
        self, name: str, page: str, settings: PlantSettings, problems: Callable[[], list[str]]
    ) -> None:
        self.name = name
        self.machines = FleetMachines()
        self.reports: PlantReports | None = None
        self.session: PlantSession | None = None
        self.members: FleetMembers | None = None
        self.takeovers = 0
        self.divided_s = 0.0
        """Time that the last division of the plant took, s."""
        self._page, self._settings, self._problems = page, settings, problems
        self._instance = secrets.token_hex(8)
        self.answer_past: Answer = _answer_nothing
        """Answers the other nodes' questions for the past."""
        self._answering: list[Answering] = []
        self._changed = asyncio.Event()
        self._opened = asyncio.Event()
        self._answer: tuple[int, bytes] = (0, b"")
        self._asked_ns = -_ASKED_NS
        self._heard: dict[str, tuple[int, RowsAnswer]] = {}

    @property
    def names(self) -> frozenset[str]:
        """Fleet nodes that are there, this one among them."""
        return frozenset((self.name,)) if self.members is None else self.members.names

    @property
    def buckets(self) -> frozenset[int]:
        """Parts of the plant that this node reads."""
        return frozenset() if self.reports is None else self.reports.buckets

    @property
    def is_connected(self) -> bool:
        """Tell whether a router of the plant is there now."""
        return self.session is not None and self.session.is_connected

    def refused(self) -> Counter[tuple[str, str]]:
        """Payloads that were refused, by key and reason."""
        return Counter() if self.reports is None else self.reports.refusals.counts()

    async def run(self, heart: Heartbeat) -> None:
        """Take part, and divide the plant anew whenever a node comes or goes; until cancelled."""
        if self.session is None:
            self.session = await self._join(heart)
        session = self.session.zenoh
        if self.reports is None:
            there = await heart.patiently(present_nodes(session, ASK_S))
            self.reports = PlantReports(session)
            self.members = FleetMembers(session, self.name, self._on_members, there)
            for question, answer in ((ROWS, self._on_rows), (HISTORY, self.answer_past)):
                self._answering.append(answer_packed(session, self.name, question, answer))
            self._changed.set()
            self._opened.set()
        while True:
            with heart.idle(lambda: not self._changed.is_set()):
                await self._changed.wait()
            await heart.sleep(GATHER_S)
            self._changed.clear()
            await self._divide(self.reports, heart)

    async def read(self, failures: Failures, heart: Heartbeat) -> None:
        """Take in what is heard, until cancelled."""
        with heart.idle(lambda: not self._opened.is_set()):
            await self._opened.wait()
        reports = self.reports
        assert reports is not None
        with heart.idle(lambda: reports.is_idle):
            async for heard in reports:
                heart.beat()
                with failures.borne("reports"):
                    if isinstance(heard, Heard):
                        report = heard.report
                        self.machines.on_report(report, now_ns(), heard.lost, heard.restarts)
                    else:
                        self.machines.on_presence((heard.site, heard.machine), heard.present)

    async def others(self) -> list[RowsAnswer]:
        """Knowledge of the other fleet nodes; this one learns from it."""
        self.machines.keep(self.buckets, now_ns())
        if self.session is None or self.members is None:
            return []
        answers = await ask_rows(self.session.zenoh, ASK_S)
        others = [each for each in answers if each.instance != self._instance]
        heard_ns = steady_ns()
        for answer in others:
            self.machines.learn(answer.machines)
            self._heard[answer.node] = heard_ns, answer
        names = self.names | {answer.node for answer in others}
        self._heard = {
            name: (at_ns, answer)
            for name, (at_ns, answer) in self._heard.items()
            if name in names and heard_ns - at_ns <= SILENT_NS
        }
        return [answer for _, answer in self._heard.values()]

    async def pasts(self, question: HistoryQuestion) -> dict[str, HistoryAnswer]:
        """Kept past of one axis in the stores of the other fleet nodes, by their names."""
        if self.session is None:
            return {}
        session = self.session.zenoh
        answers = await ask_all(session, HISTORY, question, HistoryAnswer, ASK_S)
        return {name: answer for name, answer in answers.items() if name != self.name}

    def told(self) -> RowsAnswer:
        """Knowledge of this node."""
        return RowsAnswer(
            node=self.name,
            instance=self._instance,
            page=self._page,
            time_ns=now_ns(),
            buckets=tuple(sorted(self.buckets)),
            machines=self.machines.told(now_ns()),
            problems=tuple(self._problems()),
        )

    async def close(self) -> None:
        """Take part no more; safe twice."""
        for each in self._answering:
            each.close()
        self._answering.clear()
        if self.session is not None:
            await self.session.close()
        self.session = None

    async def _join(self, heart: Heartbeat) -> PlantSession:
        waiting = False
        while True:
            try:
                return await heart.patiently(PlantSession.open(self._settings))
            except PlantAwayError as error:
                if not waiting:
                    log.warning("%s; waiting for it", error)
                waiting = True
                await heart.sleep(JOIN_PERIOD_S)

    async def _divide(self, reports: PlantReports, heart: Heartbeat) -> None:
        before, mine = reports.buckets, owned_by(self.name, self.names)
        if mine == before:
            return
        began_ns = steady_ns()
        reports.aim(mine)
        await heart.in_thread(reports.follow, limit_s=_LIMIT_S)
        self.machines.keep(mine, now_ns())
        self.takeovers += bool(mine - before)
        self.divided_s = (steady_ns() - began_ns) / 1e9
        nodes = ", ".join(sorted(self.names))
        log.info("%d of the plant's parts are read here; fleet nodes: %s", len(mine), nodes)

    def _on_members(self, _names: frozenset[str]) -> None:
        self._changed.set()

    async def prepare(self) -> None:
        """Hold the answer to the other nodes ready while they ask; to be called every second."""
        if steady_ns() - self._asked_ns < _ASKED_NS:
            await self._pack()

    async def _pack(self) -> bytes:
        made = await _ENCODER.run(packed, self.told())
        self._answer = steady_ns(), made
        return made

    def _on_rows(self, _key: str, _question: bytes, reply: Callable[[bytes | None], None]) -> None:
        self._asked_ns = steady_ns()
        made_ns, prepared = self._answer
        if prepared and self._asked_ns - made_ns < _READY_NS:
            reply(prepared)
            return
        packing = asyncio.ensure_future(self._pack())

        def on_packed(done: "asyncio.Future[bytes]") -> None:
            reply(None if done.cancelled() or done.exception() else done.result())

        packing.add_done_callback(on_packed)


def _answer_nothing(_key: str, _question: bytes, reply: Callable[[bytes | None], None]) -> None:
    reply(None)
