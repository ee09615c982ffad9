"""Audit log: who changed what, when and from where."""

from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field

from ...health.events.audit import AuditRecord
from ..answers import Answer, Timestamp
from ..context import StateDep
from ..problems import documented
from ..times import rfc3339

audit_router = APIRouter(prefix="/api/v1", tags=["service"])
_EXAMPLE: dict[str, Any] = {
    "number": 7,
    "time": "2026-11-21T08:15:30.000Z",
    "who": "Kim",
    "origin": "127.0.0.1",
    "action": "acknowledge",
    "target": "X sudden_drop",
    "outcome": "done",
    "data": {"note": "seen"},
    "chain": "1f1158707a0a6c96c16bac4adb629d8cfcee52823032db4d19f1ac3bfb266ebe",
    "problem": "",
}


class AuditEntryAnswer(Answer):
    """One change; `entry` members are null where damage has made the entry unreadable."""

    model_config = ConfigDict(json_schema_extra={"examples": [_EXAMPLE]})

    number: int
    time: Timestamp | None
    who: str | None
    origin: str | None = Field(description="Address, `bus`, or a process of the service.")
    action: str | None
    target: str | None
    outcome: str | None
    data: dict[str, str | float | int | None]
    chain: str = Field(description="SHA-256 of the chain before it, its number and itself.")
    problem: str = Field(description="Why the log cannot be trusted; empty if it can.")


class AuditAnswer(Answer):
    """Part of the audit log, oldest first."""

    newest: int = Field(description="Number of the newest entry; entries are numbered from 1.")
    problem: str = Field(description="What is gone or changed; empty if all entries are there.")
    entries: list[AuditEntryAnswer]


@audit_router.get("/audit", response_model=AuditAnswer, responses=documented(422))
def audit(
    state: StateDep,
    before: Annotated[int | None, Query(ge=1, description="Only entries before this one.")] = None,
    limit: Annotated[
        int, Query(ge=1, le=10_000, description="At most this many, the newest.")
    ] = 100,
) -> AuditAnswer:
    """Audit log: commands, uploads, removals, jobs, sign-ins, starts; it is never shortened."""
    newest = state.events.entries
    end = newest + 1 if before is None else min(before, newest + 1)
    first = max(end - limit, 1)
    records = state.events.records(first, end - first) if end > first else []
    problem = state.events.audit_problem
    return AuditAnswer(newest=newest, problem=problem, entries=[_answer(each) for each in records])


def _answer(record: AuditRecord) -> AuditEntryAnswer:
    entry = record.entry
    return AuditEntryAnswer(
        number=record.number,
        time=entry and rfc3339(entry.time_ns),
        who=entry and entry.who,
        origin=entry and entry.origin,
        action=entry and entry.action,
        target=entry and entry.target,
        outcome=entry and entry.outcome,
        data=entry.data if entry else {},
        chain=record.chain,
        problem=record.problem,
    )
