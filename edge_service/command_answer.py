"""Answer of a command: words for people, and the same as a typed document for programs."""

from collections.abc import Callable
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Any

from .exit_status import DONE

LISTENER: ContextVar[Callable[[str], None]] = ContextVar("LISTENER", default=lambda _line: None)
"""Takes a line on what is being done; nobody does beyond the command line."""


@dataclass(frozen=True, slots=True)
class Answer:
    """One truth, told twice."""

    words: str  # lines for people
    document: Any  # a model, a data class or a mapping of values that JSON knows
    status: int = DONE  # exit status of the command

    def as_json(self) -> str:
        """The document on one line."""
        from pydantic import TypeAdapter

        written = TypeAdapter(type(self.document)).dump_json(self.document, by_alias=True)
        return written.decode("utf-8")


def progress(line: str) -> None:
    """Say what is being done, `stage` or `stage: N %`, to whoever listens."""
    LISTENER.get()(line)
