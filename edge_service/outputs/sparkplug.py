"""The format `sparkplug` of the MQTT output: an edge node with a device an axis (Sparkplug B 3.0).

Libraries for Sparkplug need the MQTT client of before 2024; so the few fields of its payload that
are needed here stand below, with the names and numbers of chapter 6 of its specification.
"""

from collections.abc import Mapping
from typing import Any

from google.protobuf import text_format
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass

from ..clock import now_ns
from ..messages.health import AlarmKind

REBIRTH = "Node Control/Rebirth"
_INT64, _DOUBLE, _BOOLEAN, _STRING = 4, 10, 11, 12
_MEMBERS = {_INT64: "long_value", _DOUBLE: "double_value", _BOOLEAN: "boolean_value"}
_PROTO = """
name: "sparkplug_b.proto" package: "sparkplug" syntax: "proto2"
message_type {
  name: "Metric"
  field { number: 1 name: "name" type: TYPE_STRING label: LABEL_OPTIONAL }
  field { number: 3 name: "timestamp" type: TYPE_UINT64 label: LABEL_OPTIONAL }
  field { number: 4 name: "datatype" type: TYPE_UINT32 label: LABEL_OPTIONAL }
  field { number: 7 name: "is_null" type: TYPE_BOOL label: LABEL_OPTIONAL }
  field { number: 11 name: "long_value" type: TYPE_UINT64 label: LABEL_OPTIONAL }
  field { number: 13 name: "double_value" type: TYPE_DOUBLE label: LABEL_OPTIONAL }
  field { number: 14 name: "boolean_value" type: TYPE_BOOL label: LABEL_OPTIONAL }
  field { number: 15 name: "string_value" type: TYPE_STRING label: LABEL_OPTIONAL }
}
message_type {
  name: "Payload"
  field { number: 1 name: "timestamp" type: TYPE_UINT64 label: LABEL_OPTIONAL }
  field {
    number: 2 name: "metrics" type: TYPE_MESSAGE type_name: ".sparkplug.Metric"
    label: LABEL_REPEATED
  }
  field { number: 3 name: "seq" type: TYPE_UINT64 label: LABEL_OPTIONAL }
}
"""
_POOL = DescriptorPool()  # of its own, so that it meets no other Sparkplug's
_POOL.Add(text_format.Parse(_PROTO, FileDescriptorProto()))
_Payload: Any = GetMessageClass(_POOL.FindMessageTypeByName("sparkplug.Payload"))
_BOUNDS = ("value", "low", "high")
METRICS: dict[str, int] = {
    **dict.fromkeys(("preload/status", "preload/method"), _STRING),
    **{f"preload/of_fresh/{name}": _DOUBLE for name in _BOUNDS},
    **{f"preload/{name}": _DOUBLE for name in ("preload_percent", "low", "high", "preload_n")},
    **{f"preload/drag_torque_nm/{name}": _DOUBLE for name in _BOUNDS},
    **{f"preload/stiffness_n_per_m/{name}": _DOUBLE for name in _BOUNDS},
    **dict.fromkeys(("health/condition", "health/next_limit/earliest"), _STRING),
    **{f"health/headline/{name}": _STRING for name in ("level", "code", "text")},
    **{f"health/advice/{name}": _STRING for name in ("task", "text")},
    **{f"health/trend/rate_fresh_percent_per_h/{name}": _DOUBLE for name in _BOUNDS},
    **{f"health/alarms/{kind}": _BOOLEAN for kind in AlarmKind},
    **{f"event/{name}": _STRING for name in ("kind", "level", "text")},
}
"""Path of the JSON member -> type of every metric that an axis will ever have."""
Values = Mapping[str, float | int | bool | str | None]


class Sparkplug:
    """Topics and payloads of one edge node; every birth begins its count of messages anew."""

    def __init__(self, site: str, machine: str) -> None:
        self._site, self._machine = site, machine
        self._birth, self._seq = -1, 0
        self._sent: dict[str, dict[str, Any]] = {}
        """Last value of each metric of the devices that are born."""
        self.commands = self._topic("NCMD")

    def begin(self) -> None:
        """Begin another connection: the death that is its will belongs to its births alone."""
        self._birth = (self._birth + 1) % 256

    def death(self) -> tuple[str, bytes]:
        """Certificate of the death that belongs to the present birth."""
        return self._topic("NDEATH"), _encoded({"bdSeq": self._birth}, None)

    def birth(self) -> tuple[str, bytes]:
        """Certificate of birth of the node."""
        self._seq = 0
        self._sent.clear()
        return self._topic("NBIRTH"), _encoded({"bdSeq": self._birth, REBIRTH: False}, self._next())

    def device(self, axis: str, values: Values | None) -> list[tuple[str, bytes]]:
        """Birth of an axis with all that is known, or what has changed; None: it is silent."""
        known = self._sent.get(axis)
        if values is None:
            self._sent.pop(axis, None)
            return [] if known is None else [self._of_device("DDEATH", axis, {})]
        if known is None:
            self._sent[axis] = dict.fromkeys(METRICS) | dict(values)
            return [self._of_device("DBIRTH", axis, self._sent[axis])]
        changed = (n for n, v in values.items() if known[n] != v or n.startswith("event/"))
        news = {name: values[name] for name in changed}
        known |= news
        return [self._of_device("DDATA", axis, news)] if news else []

    def _of_device(self, kind: str, axis: str, values: Values) -> tuple[str, bytes]:
        return f"{self._topic(kind)}/{axis}", _encoded(values, self._next())

    def _next(self) -> int:
        seq, self._seq = self._seq, (self._seq + 1) % 256
        return seq

    def _topic(self, kind: str) -> str:
        return f"spBv1.0/{self._site}/{kind}/{self._machine}"


def asks_for_birth(command: bytes) -> bool:
    """Answer of whether a command asks for the births again."""
    try:
        metrics = _Payload.FromString(command).metrics
    except DecodeError:
        return False
    return any(metric.name == REBIRTH and metric.boolean_value for metric in metrics)


def flat(prefix: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the metrics in a JSON message, by path; the first of the advice stands for all."""
    members = dict(content)
    if prefix == "health":
        active = {alarm["alarm"] for alarm in members["alarms"] if alarm["active"]}
        members["alarms"] = {kind.value: kind.value in active for kind in AlarmKind}
        members["advice"] = next(iter(members["advice"]), {})
    values = {}
    for path in METRICS:
        topic, *names = path.split("/")
        if topic == prefix:
            value: Any = members
            for name in names:
                value = value.get(name) if isinstance(value, dict) else None
            values[path] = value
    return values


def _encoded(values: Values, seq: int | None) -> bytes:
    at_ms = now_ns() // 1_000_000
    payload = _Payload(timestamp=at_ms, seq=seq)
    for name, value in values.items():
        usual = _BOOLEAN if isinstance(value, bool) else _INT64
        kind = METRICS.get(name, usual)
        metric = payload.metrics.add(name=name, timestamp=at_ms, datatype=kind)
        if value is None:
            metric.is_null = True
        else:
            setattr(metric, _MEMBERS.get(kind, "string_value"), value)
    return bytes(payload.SerializeToString())
