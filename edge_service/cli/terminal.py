"""Messages of commands while they work."""

import logging
import os
import sys

import click

from .log_rate import LogRate


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
    click.echo(f"edge-service: serving {address}")


def progress(line: str) -> None:
    """Tell a person at a terminal, or a service that asks, what is being done; else stay quiet."""
    if sys.stderr.isatty() or os.environ.get("EDGE_SERVICE_PROGRESS"):
        click.echo(line, err=True)
