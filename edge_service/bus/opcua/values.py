"""Values of an axis for OPC UA: each with its status, and null where nothing may be read."""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

from asyncua import ua
from asyncua.ua.status_codes import StatusCodes

from ...messages.answer import AxisAnswer
from ...messages.estimate import EstimateStatus

DOUBLE, STRING, TEXT = ua.VariantType.Double, ua.VariantType.String, ua.VariantType.LocalizedText
INTEGER, MOMENT = ua.VariantType.Int32, ua.VariantType.DateTime
_DEVICE_HEALTH = {
    "normal": 0,  # NORMAL
    "fault": 1,  # FAILURE
    "preload_lost": 1,
    "data_lost": 2,  # CHECK_FUNCTION: nothing that is shown may be relied upon
    "service": 2,
    "model": 3,  # OFF_SPEC: the axis does what its model does not know
    "warning": 4,  # MAINTENANCE_REQUIRED
    "preload_low": 4,
    "rate": 4,
    "sudden_drop": 1,
}
"""DeviceHealthEnumeration (OPC 10000-100, 4.5.4) by the headline's code; `unavailable` has none."""
_WITHOUT_NUMBER = {
    EstimateStatus.ESTIMATED: StatusCodes.BadConfigurationError,  # the fresh preload is not known
    EstimateStatus.UNESTIMATED: StatusCodes.BadWaitingForInitialData,
    EstimateStatus.INSUFFICIENT_EXCITATION: StatusCodes.BadNoDataAvailable,
    EstimateStatus.INVALID: StatusCodes.BadSensorFailure,
}
_Value = float | int | str | datetime | list[str] | ua.LocalizedText | None


@dataclass(frozen=True, slots=True)
class Field:
    """One variable of an axis.

    Attributes:
        kind: type of its value.
        read: value in an answer; None where there is none.
        unit: of a number.
        is_list: whether there are several values.
    """

    kind: ua.VariantType
    read: Callable[[AxisAnswer], _Value]
    unit: str = ""
    is_list: bool = False


def _of_fresh(name: str) -> Callable[[AxisAnswer], float | None]:
    def read(answer: AxisAnswer) -> float | None:
        interval = answer.of_fresh
        value: float | None = None if interval is None else getattr(interval, name)
        return value

    return read


def _level(answer: AxisAnswer) -> float | None:
    return None if answer.of_fresh is None else answer.estimate.level


def _headline(name: str) -> Callable[[AxisAnswer], str | None]:
    def read(answer: AxisAnswer) -> str | None:
        headline = answer.health.headline
        return None if headline is None else str(getattr(headline, name))

    return read


def _advice(name: str) -> Callable[[AxisAnswer], str]:
    return lambda answer: "" if answer.advice is None else str(getattr(answer.advice, name))


def _text(read: Callable[[AxisAnswer], str | None]) -> Callable[[AxisAnswer], _Value]:
    def localized(answer: AxisAnswer) -> _Value:
        said = read(answer)
        return None if said is None else ua.LocalizedText(said, "en")

    return localized


def _device_health(answer: AxisAnswer) -> int | None:
    return _DEVICE_HEALTH.get(answer.health.headline.code if answer.health.headline else "")


def _due(answer: AxisAnswer) -> datetime | None:
    return None if answer.due_ns is None else datetime.fromtimestamp(answer.due_ns / 1e9, UTC)


PRELOAD, HEALTH, ADVICE, DUE = "Preload", "DeviceHealth", "Advice", "AdviceDue"
FIELDS: dict[str, Field] = {
    PRELOAD: Field(DOUBLE, _of_fresh("value"), "%"),
    "PreloadLow": Field(DOUBLE, _of_fresh("low"), "%"),
    "PreloadHigh": Field(DOUBLE, _of_fresh("high"), "%"),
    "PreloadLevel": Field(DOUBLE, _level),
    "EstimateStatus": Field(STRING, lambda answer: answer.estimate.status.value),
    "Condition": Field(STRING, lambda answer: answer.health.condition.value),
    "Reasons": Field(STRING, lambda answer: list(answer.health.reasons), is_list=True),
    "HeadlineCode": Field(STRING, _headline("code")),
    "Headline": Field(TEXT, _text(_headline("text"))),
    "AdviceCode": Field(STRING, _advice("task")),
    ADVICE: Field(TEXT, _text(_advice("text"))),
    DUE: Field(MOMENT, _due),
    HEALTH: Field(INTEGER, _device_health),
}
"""Variables of an axis by name."""


def data_values(answer: AxisAnswer) -> dict[str, ua.DataValue]:
    """Values of all variables of an axis, from the moment of the newest sample behind them."""
    measured = None if answer.measured_ns is None else _moment(answer.measured_ns)
    return {name: _data_value(field, answer, measured) for name, field in FIELDS.items()}


def _moment(time_ns: int) -> ua.DateTime:
    return ua.DateTime.fromtimestamp(time_ns / 1e9, UTC)


def _data_value(field: Field, answer: AxisAnswer, measured: ua.DateTime | None) -> ua.DataValue:
    value = field.read(answer)
    if value is None:
        return ua.DataValue(StatusCode=ua.StatusCode(ua.UInt32(_missing(field, answer))))
    return ua.DataValue(ua.Variant(value, field.kind), SourceTimestamp=measured)


def _missing(field: Field, answer: AxisAnswer) -> int:
    """Status of a value that is not there: why it is not."""
    if not answer.is_heard:
        return StatusCodes.BadNoCommunication
    if field.kind is DOUBLE:
        return _WITHOUT_NUMBER[answer.estimate.status]
    return StatusCodes.BadNoDataAvailable
