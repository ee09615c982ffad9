"""Interface of the routes of recordings and jobs to whoever keeps and runs them."""

from collections.abc import AsyncIterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Protocol, Self

from pydantic import ConfigDict, Field, WithJsonSchema, model_validator

from .answers import Answer, Timestamp

RECORDING_NAME = r"[A-Za-z0-9_][A-Za-z0-9_.\- ]{0,99}\.(csv|parquet)"
RecordingName = Annotated[str, WithJsonSchema({"type": "string", "pattern": f"^{RECORDING_NAME}$"})]
"""Name of a recording; whoever keeps them judges it."""


class JobKind(StrEnum):
    """Kind of result that can be made of recordings."""

    FINGERPRINT = "fingerprint"
    DIAGNOSE = "diagnose"
    DRIFT = "drift"


class JobState(StrEnum):
    """Progress of a job."""

    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


class RecordingAnswer(Answer):
    """One recording that was uploaded."""

    name: str
    size: int = Field(description="Bytes.")
    uploaded: Timestamp


class RecordingsAnswer(Answer):
    """All recordings, newest first."""

    recordings: list[RecordingAnswer]


class JobBody(Answer):
    """Request for a job: what is to be made of which recordings."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"kind": "fingerprint", "axis": "X", "recordings": ["friction.csv"]}]
        }
    )

    kind: JobKind
    axis: str
    recordings: list[RecordingName] = Field(
        min_length=1, max_length=50, description="Names; of `drift` two or more, oldest first."
    )
    baseline: int | None = Field(None, description="An older fingerprint job to compare with.")

    @model_validator(mode="after")
    def _has_two_to_compare(self) -> Self:
        if self.kind is JobKind.DRIFT and len(set(self.recordings)) < 2:
            raise ValueError("drift: expected two recordings or more, oldest first")
        if self.kind is JobKind.DRIFT and self.baseline is not None:
            raise ValueError(
                "drift: takes no baseline; the first recording is what it compares with"
            )
        return self


class JobAnswer(Answer):
    """One job."""

    id: int
    kind: JobKind
    axis: str
    recordings: list[str]
    baseline: int | None
    state: JobState
    started: Timestamp
    ended: Timestamp | None
    lines: list[str] = Field(description="What it said so far, the last lines.")
    files: list[str] = Field(description="What it made, once it is done.")


class DiagnoseBody(Answer):
    """Recordings that are kept here, all of one axis and one session."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"recordings": ["disagreement_X_20261121T081530Z.parquet"]}]
        }
    )

    recordings: list[RecordingName] = Field(min_length=1, max_length=50)


class JobsAnswer(Answer):
    """All jobs, newest first."""

    jobs: list[JobAnswer]


class RefusedError(Exception):
    """Refusal of a request; the text is one line, `status` the HTTP status that says so."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


class JobDesk(Protocol):
    """Keeps recordings and runs one job at a time. Every call may raise RefusedError."""

    def recordings(self) -> list[RecordingAnswer]:
        """All recordings, newest first."""
        ...

    async def receive(self, name: str, chunks: AsyncIterator[bytes]) -> RecordingAnswer:
        """Keep a recording; whole or not at all."""
        ...

    def recording(self, name: str) -> Path:
        """File of a recording."""
        ...

    def remove(self, name: str) -> None:
        """Forget a recording."""
        ...

    def jobs(self) -> list[JobAnswer]:
        """All jobs, newest first."""
        ...

    def newest(self, kind: JobKind, axis: str) -> JobAnswer | None:
        """The newest job of a kind on an axis; None before the first."""
        ...

    def check_free(self) -> None:
        """Refuse while a job runs."""
        ...

    async def start(self, body: JobBody) -> JobAnswer:
        """Start a job; refused while another one runs."""
        ...

    async def cancel(self, number: int) -> JobAnswer:
        """End a job that runs."""
        ...

    def file(self, number: int, name: str) -> Path:
        """A file that a job made."""
        ...
