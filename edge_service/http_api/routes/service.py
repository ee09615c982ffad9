"""Routes of the service as a whole: alive, ready, metrics, parts, axes, log, outputs, tokens."""

from collections.abc import Awaitable, Callable, Mapping, Sequence
from typing import Annotated, Literal

from fastapi import APIRouter, Query, Request
from fastapi.responses import Response
from pydantic import Field
from starlette.exceptions import HTTPException

from ... import __version__
from ...health.service_state import ServiceState
from ...health.store.outbox import Counts, Outbox
from ...health.store.store import Store, StoreFailedError
from ...health.store.tokens import MOST_LETTERS, NAME, Role, Token, TokenError
from ...messages.answer import AxesAnswer, axis_row
from ...messages.codec import T
from ...messages.event import Event
from ...messages.health import ComponentHealth, ComponentStatus
from ...messages.interval import Frozen, TimeNs
from ..context import (
    QUESTIONS,
    AxisFilterDep,
    Moment,
    NowDep,
    Page,
    PagingDep,
    StateDep,
    from_history,
    moment_query,
    part,
)
from ..guard import AuthenticatorDep, Caller, CallerDep
from ..problems import RefusedError, problem_response

STALE_S = 3.0
"""Age from which on an output is `degraded`."""
_LAST_NS = 2**63 - 1

alive_router = APIRouter(tags=["service"])
service_router = APIRouter(tags=["service"])


class OutputAnswer(Frozen):
    """One output, what waits for it, and what it could not deliver."""

    output: str = Field(examples=["mqtt"])
    state: ComponentStatus | Literal["degraded"]
    age_s: float | None = Field(description="Age of the oldest that it has or that waits, s.")
    waiting: int = Field(description="Events that are still to be delivered.")
    dead: int = Field(description="Events that it refused, kept for 30 days.")
    reason: str


class OutputsAnswer(Frozen):
    """All outputs that are configured."""

    items: list[OutputAnswer]


class OutputAction(Frozen):
    """`test` sends a test message, `requeue` tries all dead letters again, `drop` removes them."""

    action: Literal["test", "requeue", "drop"]


class Outputs:
    """The outputs by name, each with the outboxes of its receivers.

    Args:
        send_test: sends a test message by an output; returns the problem of each receiver.
    """

    def __init__(
        self,
        store: Store,
        outboxes: Mapping[str, Sequence[Outbox]],
        send_test: Callable[[str], Awaitable[dict[str, str]]],
    ) -> None:
        self._store, self._outboxes, self._send_test = store, outboxes, send_test
        self.names = tuple(outboxes)

    async def counts(self, output: str) -> Counts:
        """Events of an output that wait, and its dead letters. Raises RefusedError."""
        counts = [await self._ask(outbox.counts) for outbox in self._outboxes[output]]
        oldest_ns = [each.oldest_ns for each in counts if each.oldest_ns is not None]
        waiting, dead = sum(each.waiting for each in counts), sum(each.dead for each in counts)
        return Counts(waiting, dead, min(oldest_ns, default=None))

    async def act(self, output: str, action: Literal["test", "requeue", "drop"]) -> None:
        """Send a test message, try dead letters again, or drop them. Raises RefusedError."""
        if output not in self._outboxes:
            there = ", ".join(self._outboxes) or "none"
            raise RefusedError(404, f"no output {output!r}; there are {there}")
        if not self._outboxes[output]:
            raise RefusedError(409, f"{output} takes no events, so there is nothing to {action}")
        if action == "test":
            problems = await self._send_test(output)
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


class ServiceAnswer(Frozen):
    """Health of the whole service."""

    time: TimeNs = Field(description="Time of this answer, by the clock of the service.")
    ready: bool
    reasons: list[str] = Field(description="Why the service is not ready, per axis.")
    version: str = Field(description="Version of edge-service.")
    configuration: str = Field(
        description="Digest of the configuration that it was started with; empty without a file."
    )
    site: str
    machine: str
    store: str = Field(description="Where and how long history is kept.")
    components: list[ComponentHealth] = Field(description="All parts; those of an axis name it.")
    outputs: list[OutputAnswer]


class NumberedEvent(Event):
    """One event with the number under which the live stream knows it."""

    id: int


class TokensAnswer(Frozen):
    """All tokens by name."""

    items: tuple[Token, ...]
    caller: Caller


class TokenBody(Frozen):
    """Request for a token."""

    name: str = Field(pattern=NAME, max_length=MOST_LETTERS, examples=["kim"])
    role: Role


class NewTokenAnswer(TokenBody):
    """A token that was made."""

    token: str = Field(description="The token; it is shown only here.")


OutputsDep = Annotated[Outputs, part("outputs")]
MetricsDep = Annotated[Callable[[], Awaitable[tuple[bytes, str]]], part("metrics")]


@alive_router.get("/healthz")
async def alive() -> dict[str, bool]:
    """The process answers."""
    return {"alive": True}


@service_router.get("/readyz", response_model=dict[str, bool])
async def ready(request: Request, state: StateDep, now_ns: NowDep) -> dict[str, bool] | Response:
    """Every axis has fresh input; 503 with reasons if not."""
    reasons = state.unready(now_ns)
    if not reasons:
        return {"ready": True}
    detail = "an input is stale or was never received"
    return problem_response(request.url.path, 503, detail, reasons=list(reasons))


@service_router.get("/metrics", response_class=Response)
async def metrics(scrape: MetricsDep) -> Response:
    """Metrics in the text format of Prometheus; a number that does not exist has no sample."""
    text, content_type = await scrape()
    return Response(text, media_type=content_type)


@service_router.get("/api/v1/health")
async def service_health(request: Request, state: StateDep, now_ns: NowDep) -> ServiceAnswer:
    """Health of the whole service: is it ready, its parts, its outputs."""
    outputs = await output_items(state, now_ns, getattr(request.app.state, "outputs", None))
    return service_answer(state, now_ns, outputs)


def service_answer(state: ServiceState, now_ns: int, outputs: list[OutputAnswer]) -> ServiceAnswer:
    """Health of the service, with that of its outputs."""
    reasons = state.unready(now_ns)
    return ServiceAnswer(
        time=now_ns,
        ready=not reasons,
        reasons=list(reasons),
        version=__version__,
        configuration=state.configuration,
        site=state.place.site,
        machine=state.place.machine,
        store=state.kept,
        components=list(state.components(now_ns)),
        outputs=outputs,
    )


@service_router.get("/api/v1/axes")
async def axes(state: StateDep, now_ns: NowDep) -> AxesAnswer:
    """All axes, the worst first: condition, what to do, preload, next limit."""
    rows = [axis_row(state.health(axis, now_ns), now_ns) for axis in state.axes]
    return AxesAnswer(
        site=state.place.site,
        machine=state.place.machine,
        axes=tuple(sorted(rows, key=lambda row: row.urgency)),
    )


@service_router.get("/api/v1/log")
async def log(
    state: StateDep,
    axis: AxisFilterDep,
    paging: PagingDep,
    kind: Annotated[list[str] | None, Query(description="Only of this kind; repeatable.")] = None,
    start_s: Annotated[Moment | None, moment_query("from", "the first event")] = None,
    end_s: Annotated[Moment | None, moment_query("to", "the last event")] = None,
) -> Page[NumberedEvent]:
    """Events, notes and commands, with who and from where; of an axis also the service's."""
    found = await from_history(
        state.events.page,
        paging.limit + 1,
        axis,
        kind or (),
        0 if start_s is None else round(start_s * 1e9),
        _LAST_NS if end_s is None else round(end_s * 1e9),
        paging.before,
    )
    events = [NumberedEvent(**dict(each.event), id=each.id) for each in found]
    return paging.page(events, [each.id for each in events])


@service_router.get("/api/v1/outputs", tags=["outputs"])
async def outputs(state: StateDep, now_ns: NowDep, there: OutputsDep) -> OutputsAnswer:
    """Outputs, what waits for them and what they could not deliver."""
    return OutputsAnswer(items=await output_items(state, now_ns, there))


async def output_items(
    state: ServiceState, now_ns: int, outputs: Outputs | None
) -> list[OutputAnswer]:
    """Every output as it does now."""
    items: list[OutputAnswer] = []
    if outputs is None:
        return items
    reports = {each.component: each for each in state.components(now_ns, None)}
    for name in outputs.names:
        counts, report = await outputs.counts(name), reports.get(name)
        status = ComponentStatus.STARTING if report is None else report.status
        age_s = None if report is None else report.readings.get("age_s")
        if age_s is not None and counts.oldest_ns is not None:
            age_s = max(age_s, (now_ns - counts.oldest_ns) / 1e9)
        is_late = status is ComponentStatus.OK and age_s is not None and age_s > STALE_S
        items.append(
            OutputAnswer(
                output=name,
                state="degraded" if is_late else status,
                age_s=age_s,
                waiting=counts.waiting,
                dead=counts.dead,
                reason="" if report is None else report.reason,
            )
        )
    return items


@service_router.post("/api/v1/outputs/{output}", tags=["outputs"], status_code=204)
async def act(output: str, body: OutputAction, outputs: OutputsDep) -> None:
    """Send a test message by an output, or decide on its dead letters."""
    await outputs.act(output, body.action)


@service_router.get("/api/v1/tokens")
async def tokens(authenticator: AuthenticatorDep, caller: CallerDep) -> TokensAnswer:
    """List the tokens with their roles, and tell who asks."""
    known = authenticator.tokens
    found = () if known is None else await QUESTIONS.run(known.all)
    return TokensAnswer(items=found, caller=caller)


@service_router.post("/api/v1/tokens", status_code=201)
async def add_token(
    authenticator: AuthenticatorDep, body: TokenBody, now_ns: NowDep
) -> NewTokenAnswer:
    """Create a token; from the first one on every request needs one."""
    try:
        secret = await QUESTIONS.run(authenticator.kept.add, body.name, body.role, now_ns)
    except TokenError as error:
        raise HTTPException(409, str(error)) from None
    await QUESTIONS.run(authenticator.refresh, now_ns)
    return NewTokenAnswer(name=body.name, role=body.role, token=secret)


@service_router.delete("/api/v1/tokens/{name}", status_code=204)
async def revoke_token(authenticator: AuthenticatorDep, name: str, now_ns: NowDep) -> None:
    """Revoke a token at once."""
    try:
        await QUESTIONS.run(authenticator.kept.revoke, name)
    except TokenError as error:
        raise HTTPException(404, str(error)) from None
    await QUESTIONS.run(authenticator.refresh, now_ns)
