"""State of an axis for Home Assistant, and the description by which that reads it."""

import json
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from hashlib import sha256
from typing import Any

from ... import __version__
from ...messages.health import AxisCondition
from ...messages.topics import HEALTH, PRELOAD

LONGEST_STATE = 255
"""Letters of a state that Home Assistant takes."""
_PERCENT: dict[str, Any] = {
    "platform": "sensor",
    "unit_of_measurement": "%",
    "state_class": "measurement",
    "suggested_display_precision": 0,
}
_TEXT = {"platform": "sensor"}
_CONDITIONS = [each.value for each in AxisCondition if each is not AxisCondition.UNAVAILABLE]
COMPONENTS: dict[str, dict[str, Any]] = {
    "preload": _PERCENT | {"name": "Preload"},
    "preload_low": _PERCENT | {"name": "Preload, lower bound", "entity_category": "diagnostic"},
    "preload_high": _PERCENT | {"name": "Preload, upper bound", "entity_category": "diagnostic"},
    "condition": _TEXT | {"name": "Condition", "device_class": "enum", "options": _CONDITIONS},
    "headline": _TEXT | {"name": "Headline"},
    "advice": _TEXT | {"name": "To do"},
    "next_limit": _TEXT | {"name": "Next limit, earliest", "device_class": "timestamp"},
    "problem": {"platform": "binary_sensor", "name": "Problem", "device_class": "problem"},
}
"""Values of an axis for Home Assistant, by member of its state."""
_OF_PRELOAD = {"preload": "preload_percent", "preload_low": "low", "preload_high": "high"}
_OF_HEALTH = tuple(name for name in COMPONENTS if name not in _OF_PRELOAD)


class DeviceState:
    """State of one axis; a member is None while it may not be read.

    Args:
        fresh_percent: preload of the fresh screw, percent of the load rating; None if not known.

    Attributes:
        members: by name, and `alarms`, the words of each active one.
    """

    def __init__(self, fresh_percent: float | None) -> None:
        self._fresh = fresh_percent
        self._health_ns = 0
        self.members: dict[str, Any] = {}
        self.forget()

    def forget(self) -> bool:
        """Know nothing; True."""
        self.members = dict.fromkeys(COMPONENTS) | {"alarms": {}}
        return True

    def take(self, topic: str, payload: bytes) -> bool:
        """Take a message of the bus in; True if it says something of the state."""
        try:
            self.members |= self._news(topic, json.loads(payload))
        except (ValueError, KeyError, TypeError):
            return False
        return topic in (PRELOAD.name, HEALTH.name)

    def _news(self, topic: str, said: dict[str, Any]) -> dict[str, Any]:
        """Members that a message changes; a condition that is no longer renewed is unknown."""
        if topic == HEALTH.name:
            news = _health(said)
            self._health_ns = said["source_time_ns"]
            return news
        if topic != PRELOAD.name:
            return {}
        news = _preload(said, self._fresh)
        if said["source_time_ns"] - self._health_ns > 1e9 * HEALTH.stale_after_s:
            news |= dict.fromkeys(_OF_HEALTH) | {"alarms": {}}
        return news


def _preload(said: dict[str, Any], fresh: float | None) -> dict[str, Any]:
    """Percent of fresh; all None unless there is a number."""
    numbers = [said[member] for member in _OF_PRELOAD.values()]
    if said["status"] != "estimated" or not fresh or None in numbers:
        return dict.fromkeys(_OF_PRELOAD)
    return {
        name: round(100.0 * number / fresh, 2)
        for name, number in zip(_OF_PRELOAD, numbers, strict=True)
    }


def _health(said: dict[str, Any]) -> dict[str, Any]:
    active = [alarm for alarm in said["alarms"] if alarm["active"]]
    condition = said["condition"] if said["condition"] in _CONDITIONS else None
    first = next(iter(said.get("advice") or ()), None)
    return {
        "condition": condition,
        "headline": _short((said.get("headline") or {}).get("text")),
        "advice": _short(None if first is None else first["text"]),
        "next_limit": _next_limit(said),
        "problem": "ON" if active else None if condition is None else "OFF",
        "alarms": {alarm["kind"]: alarm["message"] for alarm in active},
    }


def _next_limit(said: dict[str, Any]) -> str | None:
    """Earliest time of the limit that comes first, as far as the trend can tell."""
    crossings = (said.get("trend") or {}).get("crossings") or ()
    times_ns = [each["earliest_ns"] for each in crossings if each["earliest_ns"] is not None]
    if not times_ns:
        return None
    return datetime.fromtimestamp(min(times_ns) / 1e9, UTC).isoformat(timespec="seconds")


def _short(text: str | None) -> str | None:
    return None if text is None else text[:LONGEST_STATE]


def identifier(machine: str, axis: str) -> str:
    """Name of a device for ever."""
    return f"edge-service/{machine}/{axis}"


def axis_of_identifier(machine: str, identifiers: Sequence[Any]) -> str | None:
    """Axis that identifiers name; None if they are not of this machine."""
    begin = identifier(machine, "")
    for each in identifiers:
        if isinstance(each, str) and each.startswith(begin) and "/" not in each[len(begin) :]:
            return each[len(begin) :]
    return None


def object_id(name: str) -> str:
    """Name of a device in a topic: letters, digits, `_` and `-`, alike only for the same name."""
    return f"{re.sub('[^A-Za-z0-9_-]', '_', name)}_{sha256(name.encode()).hexdigest()[:8]}"


def discovery(
    name: str, shown_name: str, state_topic: str, online_topic: str, expire_s: int
) -> dict[str, Any]:
    """Description of one axis as a device.

    Args:
        expire_s: time without a state after which nothing may be shown.
    """
    return {
        "device": {
            "identifiers": [name],
            "name": shown_name,
            "manufacturer": "edge-service",
            "model": "Ball screw",
            "sw_version": __version__,
        },
        "origin": {"name": "edge-service", "sw_version": __version__},
        "components": {
            member: facts
            | {
                "unique_id": f"{object_id(name)}_{member}",
                "value_template": f"{{{{ value_json.{member} }}}}",
                "expire_after": expire_s,
            }
            | (_ATTRIBUTES | {"json_attributes_topic": state_topic} if member == "problem" else {})
            for member, facts in COMPONENTS.items()
        },
        "state_topic": state_topic,
        "availability": [
            {"topic": online_topic, "payload_available": "true", "payload_not_available": "false"}
        ],
        "qos": 1,
    }


_ATTRIBUTES = {"json_attributes_template": "{{ value_json.alarms | tojson }}"}
