"""The payload of Sparkplug B as a message of Protocol Buffers.

Only what is sent or read here: names, numbers and types of the fields are those of chapter 6 of the
Sparkplug 3.0 specification; others are skipped when reading, as Protocol Buffers do.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

_FIELDS: dict[str, tuple[tuple[int, str, str], ...]] = {
    "PropertyValue": ((1, "type", "uint32"), (2, "is_null", "bool"), (8, "string_value", "string")),
    "PropertySet": ((1, "keys", "string*"), (2, "values", "PropertyValue*")),
    "Metric": (
        (1, "name", "string"),
        (3, "timestamp", "uint64"),
        (4, "datatype", "uint32"),
        (5, "is_historical", "bool"),
        (7, "is_null", "bool"),
        (9, "properties", "PropertySet"),
        (10, "int_value", "uint32"),
        (11, "long_value", "uint64"),
        (13, "double_value", "double"),
        (14, "boolean_value", "bool"),
        (15, "string_value", "string"),
    ),
    "Payload": ((1, "timestamp", "uint64"), (2, "metrics", "Metric*"), (3, "seq", "uint64")),
}
"""Message -> number, name and type of its fields; an asterisk is a repeated one."""


class DataType(IntEnum):
    """Types of values that occur here (6.4.16), by their number on the wire."""

    INT64 = 4
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12
    DATETIME = 13


_VALUE_FIELDS = {
    DataType.INT64: "long_value",
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
    DataType.STRING: "string_value",
    DataType.DATETIME: "long_value",
}
Value = float | int | bool | str | None


@dataclass(frozen=True, slots=True)
class Metric:
    """One value at one time.

    Attributes:
        value: None is "there is none", which travels as such.
        time_ms: UNIX time at which it was acquired, ms.
        unit: sent with a birth; empty for none.
    """

    name: str
    type: DataType
    value: Value
    time_ms: int
    unit: str = ""


def encode_payload(
    metrics: list[Metric], time_ms: int, seq: int | None, *, historical: bool = False
) -> bytes:
    """A payload that is sent at `time_ms` (UNIX, ms); `seq` is None in a death certificate."""
    payload = _PAYLOAD(timestamp=time_ms)
    if seq is not None:
        payload.seq = seq
    for metric in metrics:
        _fill(payload.metrics.add(), metric, historical)
    return bytes(payload.SerializeToString())


def decode_values(payload: bytes) -> dict[str, Value]:
    """The values of a payload by name; ValueError if it is none."""
    try:
        metrics = _PAYLOAD.FromString(payload).metrics
    except DecodeError as error:
        raise ValueError(f"not a Sparkplug payload: {error}") from None
    return {metric.name: _value_of(metric) for metric in metrics}


def _fill(target: Any, metric: Metric, historical: bool) -> None:
    target.name, target.datatype, target.timestamp = metric.name, metric.type, metric.time_ms
    if historical:
        target.is_historical = True
    if metric.unit:
        target.properties.keys.append("engUnit")
        target.properties.values.add(type=DataType.STRING, string_value=metric.unit)
    if metric.value is None:
        target.is_null = True
    else:
        setattr(target, _VALUE_FIELDS[metric.type], metric.value)


def _value_of(metric: Any) -> Value:
    for name in ("boolean_value", "string_value", "double_value", "long_value", "int_value"):
        if metric.HasField(name):
            value: Value = getattr(metric, name)
            return value
    return None


def _payload_class() -> Any:
    """The class of `Payload`, in a pool of its own so that it meets no other Sparkplug's."""
    types = {name.lower(): number for name, number in FieldDescriptorProto.Type.items()}
    file = FileDescriptorProto(
        name="sparkplug_b_subset.proto", package="sparkplug", syntax="proto2"
    )
    for message, fields in _FIELDS.items():
        target = file.message_type.add(name=message)
        for number, name, kind in fields:
            field = target.field.add(name=name, number=number)
            field.label = field.LABEL_REPEATED if kind.endswith("*") else field.LABEL_OPTIONAL
            if kind.rstrip("*") in _FIELDS:
                field.type, field.type_name = field.TYPE_MESSAGE, f".sparkplug.{kind.rstrip('*')}"
            else:
                field.type = types[f"type_{kind.rstrip('*')}"]
    pool = DescriptorPool()
    pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName("sparkplug.Payload"))


_PAYLOAD = _payload_class()
