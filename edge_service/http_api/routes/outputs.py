"""Routes of the outputs: how each does, and what becomes of events that it could not deliver."""

from typing import Annotated, Any, Literal, Protocol

from fastapi import APIRouter, Depends, Request
from pydantic import ConfigDict, Field
from starlette.exceptions import HTTPException

from ...health.service_state import ServiceState
from ...health.store.outbox import Counts
from ...messages.health import ComponentHealth, ComponentStatus
from ..answers import AcceptedAnswer, Answer
from ..context import NowDep, StateDep
from ..problems import documented

STALE_S = 3.0
"""Age from which on an output is `degraded`."""
Action = Literal["test", "requeue", "drop"]
_EXAMPLE: dict[str, Any] = {
    "output": "mqtt",
    "state": "ok",
    "age_s": 0.4,
    "waiting": 0,
    "dead": 0,
    "reason": "",
}


class OutputAnswer(Answer):
    """One output, what waits for it, and what it could not deliver."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    output: str
    state: ComponentStatus | Literal["degraded"]
    age_s: float | None = Field(description="Time since it took the last answer, s.")
    waiting: int = Field(description="Events that are still to be delivered.")
    dead: int = Field(description="Events that it refused, kept for 30 days.")
    reason: str


class OutputsAnswer(Answer):
    """All outputs that are configured."""

    items: list[OutputAnswer]


class OutputAction(Answer):
    """`test` sends a test message, `requeue` tries all dead letters again, `drop` removes them."""

    action: Action


class OutputDesk(Protocol):
    """Knows the queues of the outputs. Raises RefusedError."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""
        ...

    async def counts(self, output: str) -> Counts:
        """Events of an output that wait, and its dead letters."""
        ...

    async def act(self, output: str, action: Action) -> None:
        """Send a test message, try dead letters again, or drop them."""
        ...


async def outputs_of(request: Request) -> OutputDesk:
    """Desk of the outputs."""
    desk: OutputDesk | None = request.app.state.outputs
    if desk is None:
        raise HTTPException(503, "this service has no outputs")
    return desk


DeskDep = Annotated[OutputDesk, Depends(outputs_of)]
output_router = APIRouter(
    prefix="/api/v1/outputs",
    tags=["outputs"],
    responses=documented(404, 409, 502, 503),
)


@output_router.get("", response_model=OutputsAnswer)
async def outputs(state: StateDep, now_ns: NowDep, desk: DeskDep) -> OutputsAnswer:
    """Outputs, what waits for them and what they could not deliver."""
    return OutputsAnswer(items=await output_items(state, now_ns, desk))


async def output_items(
    state: ServiceState, now_ns: int, desk: OutputDesk | None
) -> list[OutputAnswer]:
    """Every output as it does now."""
    if desk is None:
        return []
    reports = {each.component: each for each in state.components(now_ns)}
    return [_answer(name, reports.get(name), await desk.counts(name)) for name in desk.outputs]


@output_router.post("/{output}", response_model=AcceptedAnswer, status_code=202)
async def act(output: str, body: OutputAction, desk: DeskDep) -> AcceptedAnswer:
    """Send a test message by an output, or decide on its dead letters."""
    await desk.act(output, body.action)
    return AcceptedAnswer()


def _answer(name: str, report: ComponentHealth | None, counts: Counts) -> OutputAnswer:
    status = ComponentStatus.STARTING if report is None else report.status
    age_s = None if report is None else report.readings.get("age_s")
    is_late = status is ComponentStatus.OK and age_s is not None and age_s > STALE_S
    return OutputAnswer(
        output=name,
        state="degraded" if is_late else status,
        age_s=age_s,
        waiting=counts.waiting,
        dead=counts.dead,
        reason="" if report is None else report.reason,
    )
