"""History of an axis for who asks on the bus: `.../{axis}/history?from=..;to=..;step=..`."""

import asyncio
from collections.abc import Callable

from ...bus.questions import Answering
from ...clock import now_ns
from ...health.service_state import ServiceState
from ...http_api.routes.history import answer_selector
from .context import NodeContext


def answer_history(context: NodeContext, state: ServiceState) -> Answering:
    """Answer as HTTP does, until it is closed; a wrong question by `{"detail": ...}`."""
    keys = context.config.keys
    at_work: set[asyncio.Task[None]] = set()

    async def find(axis: str, selector: str, reply: Callable[[bytes | None], None]) -> None:
        reply(await context.store.run(answer_selector, state, axis, selector, now_ns()))

    def answer(key: str, question: bytes, reply: Callable[[bytes | None], None]) -> None:
        axis = key.removesuffix("/history").rpartition("/")[2]
        if axis not in state.axes or key != f"{keys.root}/{axis}/history":
            reply(None)
            return
        task = asyncio.create_task(find(axis, question.decode(errors="replace"), reply))
        at_work.add(task)
        task.add_done_callback(at_work.discard)

    return context.bus.answer(f"{keys.root}/*/history", answer)
