"""Commands that were answered lately: one that comes again with its key is not done again."""

import hashlib
from collections.abc import Iterable

from ..messages.alarm import Command, Outcome
from ..messages.estimate import Frozen

MOST_ANSWERED = 100
"""Commands of an axis that are known again; the oldest go."""
_REUSED = "this key was given to another command"
_NOT_COMPARED = {"key", "origin"}


class AnsweredCommand(Frozen):
    """A command with a key, and its outcome; both are kept with the state that it led to.

    Attributes:
        sha256: of all of the command but its key and where it came from.
    """

    key: str
    sha256: str
    accepted: bool
    message: str


class AnsweredCommands:
    """The newest commands with a key of one axis."""

    def __init__(self) -> None:
        self._known: dict[str, AnsweredCommand] = {}

    def outcome(self, command: Command) -> Outcome | None:
        """Outcome of the same command; None if its key is new, or it has none."""
        known = self._known.get(command.key)
        if known is None:
            return None
        if known.sha256 != _digest(command):
            return Outcome(accepted=False, message=_REUSED, reused=True)
        return Outcome(accepted=known.accepted, message=known.message)

    def note(self, command: Command, outcome: Outcome) -> None:
        """Remember what came of a command with a key."""
        if not command.key:
            return
        self._known[command.key] = AnsweredCommand(
            key=command.key,
            sha256=_digest(command),
            accepted=outcome.accepted,
            message=outcome.message,
        )
        while len(self._known) > MOST_ANSWERED:
            del self._known[next(iter(self._known))]

    def snapshot(self) -> list[AnsweredCommand]:
        """All that are known, oldest first."""
        return list(self._known.values())

    def restore(self, known: Iterable[AnsweredCommand]) -> None:
        """Go on from a snapshot."""
        self._known = {each.key: each for each in known}


def _digest(command: Command) -> str:
    content = command.model_dump_json(exclude=_NOT_COMPARED)
    return hashlib.sha256(content.encode()).hexdigest()
