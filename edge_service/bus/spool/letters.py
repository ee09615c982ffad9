"""Letters of a spool: those that wait, and the dead ones that nobody would take."""

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from .file import BURIED, INSERT, new_row
from .ledger import Change, Ledger
from .message import DeadLetter, Message, checksum, is_whole

log = logging.getLogger(__name__)
MOST_DEAD = 1000
"""Dead letters that are kept; then the oldest go."""
_COLUMNS = "number, topic, payload, key, refusals, delays, checksum"
_FIRST = f"SELECT {_COLUMNS} FROM letters ORDER BY number LIMIT ?"
_NEWEST = (
    f"SELECT {_COLUMNS} FROM letters WHERE number IN "
    "(SELECT MAX(number) FROM letters GROUP BY topic)"
)
_DEAD = "SELECT key, topic, payload, tries, reason, time_ns, checksum FROM dead ORDER BY number"
_MAKE_ROOM = (
    "DELETE FROM letters WHERE number IN (SELECT number FROM letters ORDER BY number "
    "LIMIT (SELECT MAX(0, waiting - ?) FROM figures))"
)
_TOO_LARGE = (
    "DELETE FROM letters WHERE number = (SELECT MIN(number) FROM letters) "
    "AND (SELECT bytes FROM figures) > ?"
)
_FORGET_OLDEST = "DELETE FROM dead WHERE number <= (SELECT MAX(number) FROM dead) - ?"
_FIGURES = (
    "SELECT waiting, bytes, (SELECT COUNT(*) FROM dead), "
    "(SELECT COALESCE(MAX(number), 0) FROM letters), mark FROM figures"
)
_MARK = "UPDATE figures SET mark = MAX(mark, ?)"
_DELETE = "DELETE FROM letters WHERE key = ?"
_FORGET = "DELETE FROM dead WHERE key = ?"
_REVIVE = (
    "INSERT OR IGNORE INTO letters (key, topic, payload, checksum) "
    "SELECT key, topic, payload, checksum FROM dead WHERE key = ?"
)


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of a spool.

    Attributes:
        waiting, bytes: of the letters that wait.
        dead: letters that nobody would take.
        number: of the newest letter.
        mark: highest mark of the letters that were ever put in.
    """

    waiting: int = 0
    bytes: int = 0
    dead: int = 0
    number: int = 0
    mark: int = 0


class Letters:
    """Letters in a file: put in, taken out, counted, buried. For one thread.

    Args:
        path: of the file; its folder is made.
        most, most_bytes: what it holds; then the oldest go.

    Attributes:
        figures: as last looked at.
        dropped: letters that had to go because the spool was full or the disk took nothing.
        damaged: letters that were no longer what had been put in.
    """

    def __init__(self, path: Path, most: int, most_bytes: int) -> None:
        self._most, self._most_bytes = most, most_bytes
        self.ledger = Ledger(path)
        self.figures = Figures()
        self.dropped = self.damaged = 0

    def put(self, topic: str, payload: bytes, mark: int = 0) -> Message | None:
        """Append a letter; None if it is dropped."""
        if self.ledger.is_full:
            self.dropped += 1
            return None
        before, row = self.figures.waiting, new_row(topic, payload)
        marked: list[Change] = [(_MARK, (mark,))] if mark else []
        self.ledger.change([(INSERT, row), (_MAKE_ROOM, (self._most,)), *marked])
        while self.look().bytes > self._most_bytes:
            self.ledger.change([(_TOO_LARGE, (self._most_bytes,))])
        self.dropped += before + 1 - self.figures.waiting
        return Message(self.figures.number, topic, payload, row[0])

    def mark(self, mark: int) -> None:
        """Note a mark as if a letter with it had been put in."""
        self.ledger.change([(_MARK, (mark,))])
        self.look()

    def oldest(self, count: int) -> list[Message]:
        """The letters that are to go first; what is damaged is left out, counted and named."""
        messages = {Message(*row): said for *row, said in self.ledger.read(_FIRST, count)}
        broken = [
            each
            for each, said in messages.items()
            if not is_whole(each.key, each.topic, each.payload, said)
        ]
        if not broken:
            return list(messages)
        log.warning("spool: messages %s are damaged and left out", [one.number for one in broken])
        self.damaged += len(broken)
        self.remove(broken)
        return self.oldest(count)

    def remove(self, messages: Sequence[Message]) -> None:
        """Forget letters that have been taken."""
        self.ledger.change([(_DELETE, (each.key,)) for each in messages])
        self.look()

    def count(self, message: Message, *, refused: bool) -> None:
        """Count a try that failed."""
        column = "refusals" if refused else "delays"
        self.ledger.change(
            [(f"UPDATE letters SET {column} = {column} + 1 WHERE key = ?", (message.key,))]
        )

    def bury(self, letter: DeadLetter) -> None:
        """Set a letter aside: it is tried no more."""
        said = checksum(letter.key, letter.topic, letter.payload)
        row = (letter.key, letter.topic, letter.payload, said)
        change = (BURIED, (*row, letter.tries, letter.reason, letter.time_ns))
        oldest = (_FORGET_OLDEST, (MOST_DEAD,))
        self.ledger.change([change, (_DELETE, (letter.key,)), oldest])
        self.look()

    def dead(self) -> list[DeadLetter]:
        """Dead letters, the oldest first."""
        letters = [(DeadLetter(*row), said) for *row, said in self.ledger.read(_DEAD)]
        return [one for one, said in letters if is_whole(one.key, one.topic, one.payload, said)]

    def revive(self, key: str) -> bool:
        """Let a dead letter wait again, as the newest; False if there is none of that key."""
        return self._take_from_grave(key, [(_REVIVE, (key,)), (_FORGET, (key,))])

    def forget(self, key: str) -> bool:
        """Forget a dead letter; False if there is none of that key."""
        return self._take_from_grave(key, [(_FORGET, (key,))])

    def newest(self) -> dict[str, Message]:
        """The newest letter that waits of each topic."""
        return {row[1]: Message(*row[:-1]) for row in self.ledger.read(_NEWEST)}

    def look(self) -> Figures:
        """Messages that wait now, and dead letters."""
        self.figures = Figures(*self.ledger.read(_FIGURES)[0])
        return self.figures

    def sessions(self) -> int:
        """Connections that were counted."""
        return int(self.ledger.read("PRAGMA user_version")[0][0])

    def count_session(self, number: int) -> None:
        """Note how many connections were counted."""
        self.ledger.change([(f"PRAGMA user_version = {number}", ())])

    def write_again(self) -> None:
        """Try once more to write what the disk would not take."""
        self.ledger.write_again()

    def close(self) -> None:
        """Write what waits and close the file; safe twice."""
        self.ledger.close()

    def _take_from_grave(self, key: str, changes: Sequence[Change]) -> bool:
        found = bool(self.ledger.read("SELECT 1 FROM dead WHERE key = ?", key))
        self.ledger.change(changes)
        self.look()
        return found
