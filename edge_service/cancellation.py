"""A cancellation that a library has swallowed still counts."""

import asyncio


def heed_cancellation() -> None:
    """Raise CancelledError if the running task was asked to end and is still at it.

    `asyncio.wait_for` of Python 3.11 returns the result instead of being cancelled where both come
    in the same turn of the event loop; a loop around it would go on for ever.
    """
    task = asyncio.current_task()
    if task is not None and task.cancelling():
        raise asyncio.CancelledError
