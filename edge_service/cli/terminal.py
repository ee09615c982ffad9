"""Messages of commands while they work, at a bounded rate, and questions to whoever is there."""

import logging
import math
import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.progress import Progress

    from ..checks.columns.guess import Question

BURST = 20
PER_S = 0.2
_LINE = "edge_service.progress"
_SIGNED = ("--torque-constant",)
"""Options whose numbers may be negative."""


def log_to_stderr() -> None:
    """Log for people, at a bounded rate; an operating system's error is one line."""
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    handler = logging.StreamHandler(sys.stderr)
    handler.addFilter(LogRate())
    handler.setFormatter(_Lines("%(asctime)s %(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


class _Lines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        """A record as text; what the system refused needs no traceback."""
        error = record.exc_info[1] if record.exc_info else None
        if not isinstance(error, OSError):
            return super().format(record)
        record.exc_info, record.exc_text = None, None
        return f"{super().format(record)} ({error})"


def announce(address: str) -> None:
    click.echo(f"edge-service: serving {address}", err=wants_json())


def progress(line: str) -> None:
    """Tell a person at a terminal, or a service that asks, what is being done; else stay quiet.

    At a terminal it is one line with the time since the first, which goes when the command ends.
    """
    if sys.stderr.isatty():
        shown = _shown()
        shown.update(shown.task_ids[0], description=line)
        shown.start()
    elif os.environ.get("EDGE_SERVICE_PROGRESS"):
        click.echo(line, err=True)


def _shown() -> "Progress":
    """The line of the running command; it goes with its context."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    context = click.get_current_context()
    if _LINE not in context.meta:
        words = TextColumn("{task.description}", markup=False)
        console = Console(stderr=True)
        shown = Progress(
            SpinnerColumn(), words, TimeElapsedColumn(), console=console, transient=True
        )
        shown.add_task("")
        context.meta[_LINE] = context.with_resource(shown)
    line: Progress = context.meta[_LINE]
    return line


def pause_progress() -> None:
    """Clear the line for something else: an answer, a question."""
    context = click.get_current_context(silent=True)
    if context is not None and _LINE in context.meta:
        context.meta[_LINE].stop()


def wants_json() -> bool:
    """Tell whether stdout of the running command belongs to a program."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.params.get("as_json"))


def at_terminal() -> bool:
    """Tell whether a person can be asked."""
    return sys.stdin.isatty() and sys.stdout.isatty() and not wants_json()


def ask_number(question: "Question") -> float | None:
    """Ask a person; an empty answer is none."""
    pause_progress()
    while True:
        said: str = click.prompt(
            f"{question.words} (for: {question.why}; empty if unknown)",
            default="",
            show_default=False,
        )
        if not said.strip():
            return None
        number = _number(said)
        if math.isfinite(number) and (number > 0.0 or question.option in _SIGNED):
            return number
        click.echo(f"expected a number{'' if question.option in _SIGNED else ' above 0'}")


def _number(said: str) -> float:
    try:
        return float(said.replace(",", "."))
    except ValueError:
        return math.nan


class LogRate(logging.Filter):
    """Lets each place that logs say `burst` lines at once, then one every `1 / per_s` seconds.

    What was left out is counted, and told with the next line of that place.
    """

    def __init__(
        self,
        burst: int = BURST,
        per_s: float = PER_S,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__()
        self._burst, self._per_s, self._clock = burst, per_s, clock
        self._places: dict[tuple[str, int], _Place] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        """Tell whether a record is to be written."""
        now_s = self._clock()
        where = (record.pathname, record.lineno)
        place = self._places.setdefault(where, _Place(self._burst, now_s))
        place.lines = min(self._burst, place.lines + (now_s - place.seen_s) * self._per_s)
        place.seen_s = now_s
        if place.lines < 1.0:
            place.left_out += 1
            return False
        place.lines -= 1.0
        if place.left_out:
            record.msg = f"{record.getMessage()} (and {place.left_out} times more)"
            record.args = None
            place.left_out = 0
        return True


class _Place:
    """One place in the program that logs: lines it may write now, and those it could not."""

    def __init__(self, lines: float, now_s: float) -> None:
        self.lines, self.seen_s, self.left_out = lines, now_s, 0
