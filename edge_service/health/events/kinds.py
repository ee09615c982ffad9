"""Kinds of events, and how many of each the diary keeps of every axis.

Each kind has its own room, so that none pushes out another: what happens all the time never what
a person wrote, or was called for.
"""

MOST_CHATTER = 20_000
"""Of what happens all the time."""
MOST_KEPT = 100_000
"""Of what people do, or are called for."""
OTHER = "other"
"""All kinds that this table does not know share the room of one."""

_CHATTER = (
    "status_changed",
    "component_changed",
    "data_fault",
    "message_failed",
    "payloads_refused",
)
_KEPT = (
    "clock_changed",
    "condition_changed",
    "alarm_raised",
    "alarm_cleared",
    "alarm_acknowledged",
    "alarm_shelved",
    "alarm_unshelved",
    "note",
    "part_replaced",
    "command",
    "preload_rose",
    "model_disagrees",
    "model_agrees",
    "disagreement_recorded",
    "estimator_reset",
    "diary_damaged",
    "diary_failing",
    "diary_kept",
    "state_damaged",
    "history_damaged",
    "history_failing",
    "history_kept",
    "history_from_future",
    "diary_from_future",
    "loop_stalled",
    "task_failed",
    "task_recovered",
    "task_given_up",
    "loop_stalled",
)
KINDS = dict.fromkeys(_CHATTER, MOST_CHATTER) | dict.fromkeys(_KEPT, MOST_KEPT)
"""Every kind of the service -> how many are kept of an axis."""


def room_of(kind: str) -> tuple[str, int]:
    """Name and size of the room of a kind."""
    return (kind, KINDS[kind]) if kind in KINDS else (OTHER, MOST_CHATTER)


def is_chatter(kind: str) -> bool:
    """Tell whether a kind happens all the time, so that nothing else waits for it."""
    return kind not in _KEPT
