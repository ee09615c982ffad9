"""Signals that end a process."""

import asyncio
import signal
from contextlib import suppress


def install_stop() -> asyncio.Event:
    """An event that SIGINT and SIGTERM set."""
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        with suppress(NotImplementedError, RuntimeError):  # not the main thread: a test
            loop.add_signal_handler(number, stop.set)
    return stop
