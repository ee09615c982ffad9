"""Keeper of the log: writes reports and answers questions, in a thread of the task that it is."""

import asyncio
import json
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from ....messages.codec.bounded_json import parse_bounded
from ....messages.plant import LogQuestion, LogState, MachineReport
from ...stores.report_log import DatabaseFailedError, ReportLog
from ...supervision.heartbeat import Heartbeat

MOST_WAITING = 1000
"""Reports that may wait for a disk that takes nothing; then the oldest go, counted."""
RETRY_S = 1.0
PAUSE_S = 0.05
"""Between two answers: whoever asks without end must not keep the machine busy."""
CLOSE_S = 5.0
Reply = Callable[[bytes | None], None]


class LogKeeper:
    """The log and what waits for it; all but the file is touched by the loop alone.

    Args:
        kept: None where no log is kept; then questions are refused.
        key: on which the log is asked.
        tell: told of a log that was begun anew, in words.
    """

    def __init__(self, kept: ReportLog | None, key: str, tell: Callable[[str], None]) -> None:
        self._kept, self._key, self._tell = kept, key, tell
        self._reports: deque[MachineReport] = deque()
        self._questions: deque[tuple[LogQuestion, Reply]] = deque()
        self._wake = asyncio.Event()
        self.state: LogState | None = None
        """State of the log when it was last looked at; None before that, or without a log."""
        self.problem = ""
        """Reason for which reports cannot be kept now; empty if they are."""
        self._counts = dict.fromkeys(("logged", "log_dropped", "log_questions", "log_refused"), 0)

    def counters(self) -> dict[str, int]:
        """Counts since the start."""
        return self._counts | {"log_damaged": self._kept.damaged if self._kept else 0}

    def put(self, report: MachineReport) -> None:
        """Keep a report as soon as the disk takes it; never waits."""
        if self._kept is not None:
            self._reports.append(report)
            self._bound()
            self._wake.set()

    def ask(self, key: str, question: bytes, reply: Reply) -> None:
        """Answer a question when its turn comes; None if it cannot be meant."""
        try:
            asked = LogQuestion.model_validate_json(json.dumps(parse_bounded(question)))
        except (ValueError, RecursionError):
            asked = None
        if asked is None or self._kept is None or key != self._key:
            self._counts["log_refused"] += 1
            reply(None)
            return
        self._questions.append((asked, reply))
        self._wake.set()

    async def run(self, heart: Heartbeat) -> None:
        """Write and answer, until cancelled."""
        kept = self._kept
        if kept is None:
            return
        is_open = False
        while True:
            self._wake.clear()
            try:
                if not is_open:
                    self._look(await heart.in_thread(kept.state), kept)
                    is_open = True
                await self._write(kept, heart)
                await self._answer(kept, heart)
            except DatabaseFailedError as error:
                self._fail(str(error))
                await heart.sleep(RETRY_S)
                continue
            with heart.idle(lambda: not self._waits):
                await self._wake.wait()

    async def close(self, heart: Heartbeat) -> None:
        """Close the file; a disk that hangs is not waited for."""
        if self._kept is not None:
            with suppress(TimeoutError):
                async with asyncio.timeout(CLOSE_S):
                    await heart.in_thread(self._kept.close)

    @property
    def _waits(self) -> bool:
        return bool(self._reports or self._questions)

    async def _write(self, kept: ReportLog, heart: Heartbeat) -> None:
        while self._reports:
            report = self._reports.popleft()
            try:
                state = await heart.in_thread(kept.append, report)
            except DatabaseFailedError:
                self._reports.appendleft(report)
                self._bound()
                raise
            self._counts["logged"] += 1
            self._look(state, kept)

    async def _answer(self, kept: ReportLog, heart: Heartbeat) -> None:
        while self._questions and not self._reports:
            question, reply = self._questions.popleft()
            try:
                answer = await heart.in_thread(kept.answer, question)
            except DatabaseFailedError:
                reply(None)
                raise
            is_ours = self.state is not None and question.log == self.state.log
            self._counts["log_questions" if is_ours else "log_refused"] += 1
            reply(answer)
            await heart.sleep(PAUSE_S)

    def _look(self, state: LogState, kept: ReportLog) -> None:
        self.state, self.problem = state, ""
        while kept.news:
            self._tell(kept.news.pop(0))

    def _fail(self, problem: str) -> None:
        self.problem = problem
        while self._questions:
            self._questions.popleft()[1](None)

    def _bound(self) -> None:
        while len(self._reports) > MOST_WAITING:
            self._reports.popleft()
            self._counts["log_dropped"] += 1
