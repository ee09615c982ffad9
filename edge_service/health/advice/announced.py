"""Events of an axis as they are announced: with what the axis needs now."""

from collections.abc import Iterable

from ...messages.event import Event
from ...messages.health import AxisHealth


def announced(events: Iterable[Event], health: AxisHealth) -> tuple[Event, ...]:
    """Return the events; those of alarms and condition with the headline's code and first task."""
    return tuple(_with_advice(event, health) if _calls(event) else event for event in events)


def _calls(event: Event) -> bool:
    return event.kind == "condition_changed" or event.kind.startswith("alarm_")


def _with_advice(event: Event, health: AxisHealth) -> Event:
    headline = None if health.headline is None else health.headline.code
    task = health.advice[0].task.value if health.advice else None
    return event.model_copy(update={"data": event.data | {"headline": headline, "task": task}})
