"""Metrics of an axis: the values of a message of the bus."""

import json
from typing import Any

from ...messages.alarm import AlarmKind
from ...messages.topics import EVENT, HEALTH, PRELOAD
from .sparkplug_payload import DataType, Metric, Value

_NUMBERS = {
    "preload_percent": "%",
    "low": "%",
    "high": "%",
    "level": "",
    "preload_n": "N",
    "nis": "",
    "data_used_s": "s",
}
_HEADLINE = ("level", "code", "text")
_ADVICE = ("task", "text")
_DUE = {
    "due_earliest": "earliest_ns",
    "due_likely": "likely_ns",
    "due_latest": "latest_ns",
}
_ALARM = f"{HEALTH.name}/alarm/"
METRICS: dict[str, tuple[DataType, str]] = {
    f"{PRELOAD.name}/status": (DataType.STRING, ""),
    f"{PRELOAD.name}/reasons": (DataType.STRING, ""),
    **{f"{PRELOAD.name}/{name}": (DataType.DOUBLE, unit) for name, unit in _NUMBERS.items()},
    **{
        f"{PRELOAD.name}/drag_torque_nm/{name}": (DataType.DOUBLE, "N m")
        for name in ("value", "low", "high")
    },
    f"{HEALTH.name}/condition": (DataType.STRING, ""),
    f"{HEALTH.name}/reasons": (DataType.STRING, ""),
    f"{HEALTH.name}/since": (DataType.DATETIME, ""),
    **{f"{HEALTH.name}/headline/{name}": (DataType.STRING, "") for name in _HEADLINE},
    **{f"{HEALTH.name}/advice/{name}": (DataType.STRING, "") for name in _ADVICE},
    f"{HEALTH.name}/advice/now": (DataType.BOOLEAN, ""),
    **{f"{HEALTH.name}/advice/{name}": (DataType.DATETIME, "") for name in _DUE},
    **{_ALARM + kind: (DataType.BOOLEAN, "") for kind in AlarmKind},
    f"{EVENT.name}/kind": (DataType.STRING, ""),
    f"{EVENT.name}/severity": (DataType.STRING, ""),
    f"{EVENT.name}/message": (DataType.STRING, ""),
}
"""Name -> type and unit of every metric that an axis will ever have."""


def metrics_of(topic: str, payload: bytes) -> list[Metric]:
    """The metrics that a JSON payload of the bus holds.

    None of a topic that is not sent, or of another version, whose payloads a spool may still hold.
    """
    try:
        members = json.loads(payload)
        time_ms = members["source_time_ns"] // 1_000_000
        values = _VALUES[topic](members)
    except (ValueError, KeyError, TypeError):
        return []
    return [_metric(name, value, time_ms) for name, value in values.items()]


def unknown_metrics(time_ms: int) -> list[Metric]:
    """All metrics, of an axis of which nothing is known yet."""
    return [_metric(name, None, time_ms) for name in METRICS]


def _metric(name: str, value: Value, time_ms: int) -> Metric:
    kind, unit = METRICS[name]
    return Metric(name, kind, value, time_ms, unit)


def _preload(members: dict[str, Any]) -> dict[str, Value]:
    drag = members["drag_torque_nm"] or {}
    values = {name: members[name] for name in _NUMBERS}
    values |= {f"drag_torque_nm/{name}": drag.get(name) for name in ("value", "low", "high")}
    values |= {"status": members["status"], "reasons": "; ".join(members["reasons"])}
    return {f"{PRELOAD.name}/{name}": value for name, value in values.items()}


def _health(members: dict[str, Any]) -> dict[str, Value]:
    active = {alarm["kind"] for alarm in members["alarms"] if alarm["active"]}
    values: dict[str, Value] = {
        f"{HEALTH.name}/condition": members["condition"],
        f"{HEALTH.name}/reasons": "; ".join(members["reasons"]),
        f"{HEALTH.name}/since": members["since_time_ns"] // 1_000_000,
    }
    values |= _headline(members.get("headline") or {})
    values |= _advice(next(iter(members.get("advice") or ()), {}))
    return values | {_ALARM + kind: kind in active for kind in AlarmKind}


def _headline(headline: dict[str, Any]) -> dict[str, Value]:
    return {f"{HEALTH.name}/headline/{name}": headline.get(name) for name in _HEADLINE}


def _advice(first: dict[str, Any]) -> dict[str, Value]:
    """The most urgent task; all without a value if there is nothing to do."""
    due = first.get("due") or {}
    values: dict[str, Value] = {name: first.get(name) for name in (*_ADVICE, "now")}
    for name, member in _DUE.items():
        time_ns = due.get(member)
        values[name] = None if time_ns is None else time_ns // 1_000_000
    return {f"{HEALTH.name}/advice/{name}": value for name, value in values.items()}


def _event(members: dict[str, Any]) -> dict[str, Value]:
    return {f"{EVENT.name}/{name}": members[name] for name in ("kind", "severity", "message")}


_VALUES = {PRELOAD.name: _preload, HEALTH.name: _health, EVENT.name: _event}
