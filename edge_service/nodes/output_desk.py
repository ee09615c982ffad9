"""Outputs of one service for the page: their queues, a test message, dead letters."""

from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Literal, TypeVar

from ..clock import now_ns
from ..config import EdgeConfig
from ..health.service_state import ServiceState
from ..health.store.outbox import Counts, Outbox
from ..health.store.store import Store, StoreFailedError
from ..http_api.problems import RefusedError
from ..messages.topics import FEAT, PRELOAD
from ..outputs.base import OutputConfig, OutputContext, UnknownOutputError, load_output
from .context import NodeContext
from .output_node import make_output, outbox_of, send_test

T = TypeVar("T")
_READS = {"http": PRELOAD.name, "estimate": FEAT.name}
"""Topic whose payloads a component counts."""
Action = Literal["test", "requeue", "drop"]


class StoreOutputDesk:
    """The outputs as configured. Raises ConfigError."""

    def __init__(self, config: EdgeConfig, store: Store) -> None:
        self._config, self._store = config, store
        self._outboxes: dict[str, list[Outbox]] = {}
        for name in config.outputs:
            output = make_output(config, name)
            self._outboxes[name] = [outbox_of(store, output, each) for each in output.receivers]

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        return tuple(self._outboxes)

    async def counts(self, output: str) -> Counts:
        """Events of an output that wait, and its dead letters. Raises RefusedError."""
        counts = [await self._ask(outbox.counts) for outbox in self._outboxes[output]]
        oldest_ns = [each.oldest_ns for each in counts if each.oldest_ns is not None]
        waiting, dead = sum(each.waiting for each in counts), sum(each.dead for each in counts)
        return Counts(waiting, dead, min(oldest_ns, default=None))

    async def act(self, output: str, action: Action) -> None:
        """Send a test message, try dead letters again, or drop them. Raises RefusedError."""
        if output not in self._outboxes:
            there = ", ".join(self._outboxes) or "none"
            raise RefusedError(404, f"no output {output!r}; there are {there}")
        if not self._outboxes[output]:
            raise RefusedError(409, f"{output} takes no events, so there is nothing to {action}")
        if action == "test":
            problems = await send_test(self._config, output)
            if any(problems.values()):
                raise RefusedError(502, "; ".join(each for each in problems.values() if each))
            return
        for outbox in self._outboxes[output]:
            await self._ask(outbox.requeue if action == "requeue" else outbox.drop)

    async def _ask(self, work: Callable[[], T]) -> T:
        try:
            return await self._store.run(work)
        except StoreFailedError as error:
            raise RefusedError(503, f"the store cannot be read now ({error})") from None


class Scrape:
    """Answers a scrape by Prometheus with what holds now.

    Attributes:
        output: renders the metrics; None where it is not installed.
    """

    def __init__(self, context: NodeContext, state: ServiceState, desk: StoreOutputDesk) -> None:
        self._context, self._state, self._desk = context, state, desk
        self.output: Any = None
        with suppress(UnknownOutputError):
            place = context.config.service
            facts = OutputContext("metrics", place.site, place.machine)
            self.output = load_output("metrics")(OutputConfig(), facts)

    async def text(self) -> tuple[bytes, str]:
        """Text and its content type."""
        state, at_ns = self._state, now_ns()
        components = state.all_components(at_ns)
        temperature_c = {}
        dropped: Counter[tuple[str, str]] = Counter()
        for axis in state.axes:
            newest = state.live_now(axis)
            if newest is not None and newest.temperature_c is not None:
                temperature_c[axis] = newest.temperature_c
        for report in state.components(at_ns):
            if report.component in _READS:
                lost = report.counters.get("lost_payloads", 0)
                dropped[_READS[report.component], "gap"] += lost
        for (key, _), count in state.refused().items():
            dropped[key.rpartition("/")[2], "refused"] += count
        dropped["", "unknown"] += state.ignored_payloads
        outboxes = {}
        for name in self._desk.outputs:
            with suppress(RefusedError):
                outboxes[name] = await self._desk.counts(name)
        text = self.output.text(
            state.configuration,
            not state.unready(at_ns),
            [state.answer(axis, at_ns) for axis in state.axes],
            components,
            temperature_c,
            dropped,
            outboxes,
        )
        return text, self.output.content_type
