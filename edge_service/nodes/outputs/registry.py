"""Registry of the outputs that take events: a new one is its file and a line here."""

from collections.abc import Awaitable, Callable

from ...config import EdgeConfig
from .ordered import Answers, OrderedOutput


async def _open_webhook(
    config: EdgeConfig, on_change: Callable[[str], None], _answers: Answers
) -> OrderedOutput | None:
    if config.webhook.url is None:
        return None
    from .webhook import open_webhook  # its client takes 8 MB

    return await open_webhook(config, on_change)


async def _open_email(
    config: EdgeConfig, on_change: Callable[[str], None], answers: Answers
) -> OrderedOutput | None:
    if config.email.host is None:
        return None
    from .mail.output import open_email

    return await open_email(config, on_change, answers)


OpenOutput = Callable[[EdgeConfig, Callable[[str], None], Answers], Awaitable[OrderedOutput | None]]
"""Opens an output as configured, None if it is not; told what to call with what is wrong now."""
OPENERS: dict[str, OpenOutput] = {"webhook": _open_webhook, "email": _open_email}
"""Openers by the name that the output reports under."""
