"""Queue of messages on disk; its file is read and written beside the event loop."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

from .disk_thread import DiskThread
from .ledger import MOST_UNWRITTEN
from .letters import Letters
from .message import DeadLetter, Message

_SESSIONS = 1 << 30
"""Number at which the numbers of connections begin anew; the file has 31 bits for them."""
MOST_BYTES = 1_000_000_000
_AGAIN_S = 1.0
PATIENCE_S = 0.5
"""Time that a message may take to the disk before whoever puts it goes on."""
T = TypeVar("T")


class Spool:
    """A queue in an SQLite file. What was put in survives the process; the oldest go if it is full.

    A damaged file is set aside. A disk that takes nothing costs nothing that fits into memory, and
    is tried again. Any call may raise SpoolError where nothing can be read either.

    Args:
        path: of the file; its folder is made.
        most, most_bytes: what it holds.

    Attributes:
        newest: the newest message of each topic, taken or not, as far back as is known.
        sessions: connections that were counted, also before a restart.
    """

    def __init__(self, path: Path, most: int, most_bytes: int = MOST_BYTES) -> None:
        self._letters = Letters(path, most, most_bytes)
        self._thread = DiskThread(path.name)
        self._on_their_way = self._left_out = 0
        self._arrived = asyncio.Event()
        self.newest: dict[str, Message] = {}
        self.sessions = 0

    @classmethod
    async def open(cls, path: Path, most: int, most_bytes: int = MOST_BYTES) -> "Spool":
        """Open the queue of a file, made if it is missing."""
        spool = cls(path, most, most_bytes)
        await spool._do(spool._letters.look)
        spool.newest = await spool._do(spool._letters.newest)
        spool.sessions = await spool._do(spool._letters.sessions)
        return spool

    def __len__(self) -> int:
        return self._letters.figures.waiting

    @property
    def mark(self) -> int:
        """Highest mark of the messages that were ever put in, also before a restart."""
        return self._letters.figures.mark

    async def set_mark(self, mark: int) -> None:
        """Note a mark without a message."""
        await self._do(partial(self._letters.mark, mark))

    @property
    def dead(self) -> int:
        """Letters that are tried no more."""
        return self._letters.figures.dead

    @property
    def dropped(self) -> int:
        """Messages that had to go because spool or disk was full."""
        return self._letters.dropped + self._left_out

    @property
    def damaged(self) -> int:
        """Messages that the disk had changed."""
        return self._letters.damaged

    @property
    def problem(self) -> str:
        """Reason for which the disk takes nothing; "" while it does."""
        return self._letters.ledger.problem

    async def put(self, topic: str, payload: bytes, *, mark: int = 0) -> None:
        """Append a message; it is on the disk then.

        A disk that hangs is not waited for: the message gets there when it works again.
        """
        done = self.put_soon(topic, payload, mark=mark)
        if done is not None:
            await asyncio.wait([done], timeout=PATIENCE_S)

    def put_soon(
        self, topic: str, payload: bytes, *, mark: int = 0
    ) -> "asyncio.Future[Message | None] | None":
        """Let a message be appended; None if it is dropped, as the disk has long been hanging.

        Args:
            mark: a number that grows from one message to the next; `mark` tells the last.
        """
        if self._on_their_way >= MOST_UNWRITTEN:
            self._left_out += 1
            return None
        self._on_their_way += 1
        done = self._do(partial(self._letters.put, topic, payload, mark=mark))
        done.add_done_callback(partial(self._arrive, topic))
        return done

    def _arrive(self, topic: str, done: "asyncio.Future[Message | None]") -> None:
        self._on_their_way -= 1
        if done.cancelled() or done.exception() is not None:
            self._left_out += 1
            return
        message = done.result()
        if message is not None:
            self.newest[topic] = message
            self._arrived.set()

    async def oldest(self, count: int) -> list[Message]:
        """The messages that are to go first."""
        return await self._do(partial(self._letters.oldest, count))

    async def remove(self, messages: Sequence[Message]) -> None:
        """Forget messages that have been taken."""
        await self._do(partial(self._letters.remove, messages))

    async def count(self, message: Message, *, refused: bool) -> None:
        """Count a try that failed."""
        await self._do(partial(self._letters.count, message, refused=refused))

    async def bury(self, letter: DeadLetter) -> None:
        """Set a message aside: it is tried no more."""
        await self._do(partial(self._letters.bury, letter))

    async def letters(self) -> list[DeadLetter]:
        """Dead letters, the oldest first."""
        return await self._do(self._letters.dead)

    async def revive(self, key: str) -> bool:
        """Let a dead letter wait again, as the newest; False if there is none of that key."""
        found = await self._do(partial(self._letters.revive, key))
        self._arrived.set()
        return found

    async def forget(self, key: str) -> bool:
        """Forget a dead letter; False if there is none of that key."""
        return await self._do(partial(self._letters.forget, key))

    async def count_session(self) -> None:
        """Count a connection that was made."""
        self.sessions = (self.sessions + 1) % _SESSIONS
        await self._do(partial(self._letters.count_session, self.sessions))

    async def wait(self, count: int = 1) -> None:
        """Wait until there are so many messages."""
        while len(self) < count:
            self._arrived.clear()
            try:
                async with asyncio.timeout(_AGAIN_S if self.problem else None):
                    await self._arrived.wait()
            except TimeoutError:
                await self._do(self._letters.write_again)

    def close(self) -> None:
        """Write what waits and close the file; safe twice."""
        self._thread.close(self._letters.close)

    def _do(self, work: Callable[[], T]) -> "asyncio.Future[T]":
        return self._thread.do(work)
