"""Routes of the outputs and of what they could not deliver."""

from typing import Annotated

from fastapi import APIRouter, Depends, Request
from starlette.exceptions import HTTPException

from ...messages.outputs import KEEPING
from ..axis_answers import AcceptedAnswer
from ..context import NowDep, StateDep
from ..outputs import OutputDesk, OutputsAnswer, output_answer
from ..problems import documented

output_router = APIRouter(
    prefix="/api/v1/outputs",
    tags=["outputs"],
    responses=documented(404, 503),
)


async def outputs_of(request: Request) -> OutputDesk:
    """Desk that keeps the dead letters."""
    desk: OutputDesk | None = request.app.state.outputs
    if desk is None:
        raise HTTPException(503, "this service has no outputs")
    return desk


DeskDep = Annotated[OutputDesk, Depends(outputs_of)]


@output_router.get("", response_model=OutputsAnswer)
async def outputs(state: StateDep, now_ns: NowDep, desk: DeskDep) -> OutputsAnswer:
    """Outputs with what waits for them and what they could not deliver."""
    reports = [each for each in state.components(now_ns) if each.component in KEEPING]
    return OutputsAnswer(
        outputs=[
            output_answer(report, await desk.dead_letters(report.component)) for report in reports
        ]
    )


@output_router.post("/{output}/dead", response_model=AcceptedAnswer, status_code=202)
async def revive_all(output: str, desk: DeskDep) -> AcceptedAnswer:
    """Try all dead letters of an output again, after what waits."""
    await desk.revive_all(output)
    return AcceptedAnswer()


@output_router.post("/{output}/dead/{letter}", response_model=AcceptedAnswer, status_code=202)
async def revive(output: str, letter: str, desk: DeskDep) -> AcceptedAnswer:
    """Try a dead letter again, after what waits."""
    await desk.revive(output, letter)
    return AcceptedAnswer()


@output_router.delete("/{output}/dead/{letter}", response_model=AcceptedAnswer)
async def forget(output: str, letter: str, desk: DeskDep) -> AcceptedAnswer:
    """Drop a dead letter."""
    await desk.forget(output, letter)
    return AcceptedAnswer()
