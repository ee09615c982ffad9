"""Messages of commands while they work, and questions to whoever is there."""

import logging
import math
import os
import re
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from ..threads import repeating

if TYPE_CHECKING:
    from ..checks.columns.guess import Question

LINE_S, PIPE_S = 1.0, 10.0
"""Time between two drawings of the line at a terminal, and between two lines into a pipe."""
_LINE = "edge_service.progress"
_CLEARED = "\r\x1b[2K"
_SIGNED = ("--torque-constant",)
"""Options whose numbers may be negative."""


def log_to_stderr() -> None:
    """Log for people; an operating system's error is one line."""
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Lines("%(asctime)s %(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


class _Lines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        error = record.exc_info[1] if record.exc_info else None
        if not isinstance(error, OSError):
            return super().format(record)
        record.exc_info, record.exc_text = None, None
        return f"{super().format(record)} ({error})"


def announce(address: str) -> None:
    click.echo(f"edge-service: serving {address}", err=wants_json())


def progress(line: str) -> None:
    """Show the stage: at a terminal one line, which goes at the end; else one every ten seconds."""
    context = click.get_current_context(silent=True)
    if context is None:
        return
    if _LINE not in context.meta:
        command = context.find_root().invoked_subcommand or context.command.name or ""
        context.meta[_LINE] = shown = ProgressLine(command)
        context.call_on_close(shown.pause)
    context.meta[_LINE].tell(line)


class ProgressLine:
    """The stage of a command with its share, drawn from time to time."""

    def __init__(self, command: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._command, self._clock, self._began_s = command, clock, clock()
        self._stage, self._share, self._stage_s = "", 0, self._began_s
        self._stop: Callable[[], None] | None = None
        self._is_terminal = sys.stderr.isatty()
        self._at_once = self._is_terminal or bool(os.environ.get("EDGE_SERVICE_PROGRESS"))

    def tell(self, line: str) -> None:
        """Take the stage, with its share."""
        found = re.fullmatch(r"(.*?):? (\d+) %", line)
        stage, self._share = (found[1], int(found[2])) if found else (line, 0)
        if stage != self._stage:
            self._stage, self._stage_s = stage, self._clock()
        if self._stop is None:
            self._stop = repeating(LINE_S if self._is_terminal else PIPE_S, self.draw)
        if self._at_once:
            self.draw()

    def draw(self) -> None:
        """Draw the line, or write one."""
        now_s = self._clock()
        parts = [self._stage, *([f"{self._share} %"] if self._share else [])]
        parts.append(f"{now_s - self._began_s:.0f} s")
        if not self._is_terminal:
            click.echo(f"edge-service {self._command}: {', '.join(parts)}", err=True)
            return
        if 0 < self._share < 100:
            left_s = (now_s - self._stage_s) * (100 - self._share) / self._share
            parts.append(f"{left_s:.0f} s left")
        sys.stderr.write(f"{_CLEARED}{', '.join(parts)}")
        sys.stderr.flush()

    def pause(self) -> None:
        """Clear the line; the next stage shows it again."""
        if self._stop is not None:
            self._stop()
            self._stop = None
            if self._is_terminal:
                sys.stderr.write(_CLEARED)
                sys.stderr.flush()


def pause_progress() -> None:
    """Clear the line for something else: an answer, a question."""
    context = click.get_current_context(silent=True)
    if context is not None and _LINE in context.meta:
        context.meta[_LINE].pause()


def wants_json() -> bool:
    """Return whether stdout of the running command belongs to a program."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.params.get("as_json"))


def at_terminal() -> bool:
    """Return whether a person can be asked."""
    return sys.stdin.isatty() and sys.stdout.isatty() and not wants_json()


def ask_number(question: "Question") -> float | None:
    """Ask a person; an empty answer is none."""
    pause_progress()
    signed = question.option in _SIGNED
    while True:
        words = f"{question.words} (for: {question.why}; empty if unknown)"
        said: str = click.prompt(words, default="", show_default=False)
        if not said.strip():
            return None
        try:
            number = float(said.replace(",", "."))
        except ValueError:
            number = math.nan
        if math.isfinite(number) and (number > 0.0 or signed):
            return number
        click.echo(f"expected a number{'' if signed else ' above 0'}")
