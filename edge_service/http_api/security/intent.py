"""Intent of a change: it stands in the audit log before the change is made."""

from collections.abc import Awaitable, Callable
from contextvars import ContextVar
from functools import wraps
from typing import Any

from fastapi.routing import APIRoute

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
BEGIN: ContextVar[Callable[[], Awaitable[None]] | None] = ContextVar("begin", default=None)
"""Notes the intent of the request that is served; None outside of one."""


class ChangingRoute(APIRoute):
    """Route that notes what is asked, once it makes sense and before anything is done."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **settings: Any) -> None:
        safe = set(settings.get("methods") or ()) <= set(SAFE_METHODS)
        super().__init__(path, endpoint if safe else _noted(endpoint), **settings)


def _noted(endpoint: Callable[..., Awaitable[Any]]) -> Callable[..., Awaitable[Any]]:
    @wraps(endpoint)
    async def noted(*args: Any, **values: Any) -> Any:
        begin = BEGIN.get()
        if begin is not None:
            await begin()
        return await endpoint(*args, **values)

    return noted
