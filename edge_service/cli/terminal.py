"""Messages of commands while they work."""

import logging
import os
import sys

import click


def log_to_stderr() -> None:
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(message)s"
    )


def announce(address: str) -> None:
    click.echo(f"edge-service: serving {address}")


def progress(line: str) -> None:
    """Tell a person at a terminal, or a service that asks, what is being done; else stay quiet."""
    if sys.stderr.isatty() or os.environ.get("EDGE_SERVICE_PROGRESS"):
        click.echo(line, err=True)
