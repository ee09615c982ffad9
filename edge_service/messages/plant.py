"""Report of one machine to its plant: all of its axes in one message, and where it goes."""

from dataclasses import dataclass
from typing import Annotated, Literal
from zlib import crc32

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from .advice import Headline
from .codec.bounded_json import FURTHEST, LARGEST, MOST_ENTRIES, MOST_TEXT
from .codec.interface import MOST_HEADER, CodecError
from .codec.json_message import JsonCodec
from .estimate import EstimateStatus, Interval
from .header import Header
from .health import AxisCondition

PLANT = "feeddrive/plant/v1"
"""Root of all keys of a plant's bus. Without an `@` before a machine's key: readers learn of its
publisher from a token below that key, and Zenoh does not know such a token behind an `@`."""
FLEET = "@fleet"
BUCKETS = 64
"""Parts into which the machines of a plant fall; each is read by one fleet node at a time."""


MOST_ASKED = 1000
"""Reports in one answer of a log."""
MOST_NAME = 64


class Reported(BaseModel):
    """Base of what is reported: members of a later version are left unread."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


def _bounded(interval: Interval) -> Interval:
    """The interval, if it can be computed with. Raises ValueError."""
    if max(abs(interval.value), abs(interval.low), abs(interval.high)) > FURTHEST:
        raise ValueError("a number beyond all bounds")
    return interval


Text = Annotated[str, Field(max_length=MOST_TEXT)]
Number = Annotated[float, Field(ge=-FURTHEST, le=FURTHEST)]
Integer = Annotated[int, Field(ge=-LARGEST, le=LARGEST)]
Bounded = Annotated[Interval, AfterValidator(_bounded)]


class AxisReport(Reported):
    """State of one axis, as its machine tells it.

    Attributes:
        headline: the one statement about it; None before the first.
        task: the most urgent thing to do, in words; empty if there is none.
        status: whether the numbers may be read; they are None unless it is `estimated`.
        time_ns: UNIX time of the newest sample behind them, ns; None before the first.
        preload_percent, low, high: percent of the dynamic load rating.
        fresh_percent: the fresh screw's preload, percent of the load rating; None if not known.
        fits: whether the model fits; None if nobody can tell.
        limit: `warning` or `fault`, the one that comes next, with the bounds and the middle of the
            time at which it is reached, UNIX ns; None unless the preload is falling.
        loss_per_1000_h: loss in percent of the fresh screw's preload, with its 90 % interval; None
            where there is no trend.
        reason: why there is no number, or why the condition is what it is.
    """

    axis: Text
    condition: AxisCondition
    headline: Headline | None = None
    task: Text = ""
    status: EstimateStatus
    time_ns: Integer | None = None
    preload_percent: Number | None = None
    low: Number | None = None
    high: Number | None = None
    fresh_percent: Number | None = None
    fits: bool | None = None
    limit: Text | None = None
    limit_earliest_ns: Integer | None = None
    limit_likely_ns: Integer | None = None
    limit_latest_ns: Integer | None = None
    loss_per_1000_h: Bounded | None = None
    reason: Text = ""


class LogState(Reported):
    """Content of the machine's own log, whose reports are numbered one by one.

    Attributes:
        log: name of the log; another one after it was lost or put back.
        first, last: numbers of its oldest and newest report; `last` is `first` - 1 if it is empty.
    """

    log: Text
    first: Integer
    last: Integer


class MachineReport(Reported):
    """Report of one machine.

    Attributes:
        time_ns: UNIX time at which it was made, ns.
        period_s: of its reports; a machine that is silent for several of them is not heard.
        version: of the edge-service that made it.
        configuration: digest of what it is configured by and the bundle that this came in, to tell
            who runs what; empty if unknown.
        page: address of the machine's own page; empty if others cannot reach it.
        log: None where no log is kept.
    """

    site: Text
    machine: Text
    time_ns: Integer
    period_s: float = Field(1.0, gt=0.0, le=3600.0)
    version: Text
    configuration: Text = ""
    page: Text = ""
    log: LogState | None = None
    axes: tuple[AxisReport, ...] = Field(max_length=MOST_ENTRIES)


class LogQuestion(Reported):
    """Question to a machine's log: the reports after a number, the oldest first.

    Attributes:
        log: its name, as the machine told it.
        after: number of the last report that is known; 0 for none.
        most: how many are wanted; fewer come where they would be too long for one answer.
    """

    log: str = Field(max_length=MOST_NAME)
    after: int = Field(ge=0, lt=2**63)
    most: int = Field(ge=1, le=MOST_ASKED)


class LoggedReport(Reported):
    """One report of a log, with its number."""

    number: Integer
    report: MachineReport


class LogAnswer(Reported):
    """Answer of a log; its name is another one if the question was for a log that is gone."""

    log: str
    reports: tuple[LoggedReport, ...]


class _Envelope(Reported):
    """Members of a message beside those of its payload."""

    schema_: Literal["plant/1"] = Field(alias="schema")
    sequence: int = Field(ge=0, lt=MOST_HEADER)
    boot_epoch: int = Field(ge=0, lt=MOST_HEADER)
    source_time_ns: int = Field(ge=0, lt=MOST_HEADER)
    monotonic_time_ns: int = Field(ge=0, lt=MOST_HEADER)


class ReportCodec(JsonCodec[MachineReport]):
    """Codec of reports: their bounds stand in the model, so they are read without a second look."""

    def decode(self, payload: bytes) -> tuple[str, Header, MachineReport]:
        """No axis, header and report. Raises CodecError."""
        try:
            told = _Envelope.model_validate_json(payload, strict=True)
            report = MachineReport.model_validate_json(payload, strict=True)
        except ValidationError as error:
            raise CodecError(f"no {self.schema} message: {error}") from error
        times = (told.source_time_ns, told.monotonic_time_ns)
        return "", Header(told.sequence, told.boot_epoch, *times), report


REPORT = ReportCodec("plant/1", MachineReport)
MOST_REPORT_BYTES = 500_000


@dataclass(frozen=True, slots=True)
class PlantKeys:
    """Keys of one machine on the plant's bus."""

    site: str
    machine: str

    @property
    def bucket(self) -> int:
        """The part of the plant that it falls into: the same for everybody."""
        return crc32(f"{self.site}/{self.machine}".encode()) % BUCKETS

    @property
    def report(self) -> str:
        """Key of its reports."""
        return f"{PLANT}/{self.bucket}/{self.site}/{self.machine}"

    @property
    def log(self) -> str:
        """Key on which its log answers; no wildcard of the reports' keys means it."""
        return f"{self.report}/@log"


def bucket_reports(bucket: int) -> str:
    """Key expression of the reports of all machines of one part of the plant."""
    return f"{PLANT}/{bucket}/*/*"


def fleet_node(name: str) -> str:
    """Key of a fleet node's liveliness token; `*` as the name for all of them."""
    return f"{PLANT}/{FLEET}/{name}"


def fleet_question(name: str, question: str) -> str:
    """Key on which a fleet node answers a question; `*` as the name for all of them."""
    return f"{PLANT}/{FLEET}/{name}/{question}"
