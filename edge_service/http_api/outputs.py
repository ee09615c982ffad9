"""Interface of the routes of outputs to whoever keeps what could not be delivered."""

from typing import Any, Protocol

from pydantic import ConfigDict, Field

from ..messages.health import ComponentHealth, ComponentStatus
from .answers import Answer, Timestamp

_LETTER_EXAMPLE: dict[str, Any] = {
    "id": "0d5f0b1c6d3e4f7c8a9b0c1d2e3f4a5b",
    "axis": "X",
    "kind": "alarm_raised",
    "message": "preload at 47 % of the fresh screw's; limit 60 %",
    "time": "2026-01-31T12:00:00.000Z",
    "tries": 5,
    "reason": "answered 500",
    "dead_since": "2026-01-31T12:00:07.000Z",
}


class DeadLetterAnswer(Answer):
    """A message that could not be delivered and is tried no more, until somebody asks for it."""

    model_config = ConfigDict(json_schema_extra={"examples": [_LETTER_EXAMPLE]})

    id: str
    axis: str
    kind: str = Field(description="Of the event; of another message its topic.")
    message: str
    time: Timestamp = Field(description="Of the event.")
    tries: int
    reason: str = Field(description="Result of the last attempt.")
    dead_since: Timestamp


class OutputAnswer(Answer):
    """One output, what waits for it, and what it could not deliver."""

    output: str = Field(examples=["webhook"])
    status: ComponentStatus
    reason: str
    waiting: int = Field(description="Messages that are still to be delivered.")
    delivered: int = Field(description="Since the service started, like the next two.")
    dropped: int = Field(description="Discarded because disk and memory were full.")
    damaged: int = Field(description="Damaged on the disk and therefore discarded.")
    dead_letters: list[DeadLetterAnswer]


class OutputsAnswer(Answer):
    """All outputs that are configured."""

    outputs: list[OutputAnswer]


class OutputDesk(Protocol):
    """Keeps dead letters. Every call that names one may raise RefusedError."""

    async def dead_letters(self, name: str) -> list[DeadLetterAnswer]:
        """Dead letters of an output, the oldest first."""
        ...

    async def revive(self, name: str, key: str) -> None:
        """Try a dead letter again."""
        ...

    async def revive_all(self, name: str) -> None:
        """Try all dead letters of an output again."""
        ...

    async def forget(self, name: str, key: str) -> None:
        """Drop a dead letter."""
        ...


def output_answer(report: ComponentHealth, letters: list[DeadLetterAnswer]) -> OutputAnswer:
    """The output that a component is."""
    counts = {name: report.counters.get(name, 0) for name in ("delivered", "dropped", "damaged")}
    return OutputAnswer(
        output=report.component,
        status=report.status,
        reason=report.reason,
        waiting=round(report.readings.get("waiting", 0)),
        dead_letters=letters,
        **counts,
    )
