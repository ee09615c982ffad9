"""Sizes and times of the service state, and what of it outlives the process."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from ..messages.topics import HEALTH, PRELOAD
from .store.events import EventLog
from .store.history import History


@dataclass(frozen=True, slots=True)
class StateSettings:
    """Sizes and times of the service state.

    Attributes:
        preload_stale_after_s: an estimate older than this is no longer shown.
        health_stale_after_s: the same for the condition.
        component_silent_after_s: a component silent for longer is in error; None to switch off.
        backlog_capacity: events that may wait for one slow reader.
    """

    preload_stale_after_s: float = PRELOAD.stale_after_s
    health_stale_after_s: float = HEALTH.stale_after_s
    component_silent_after_s: float | None = HEALTH.stale_after_s
    backlog_capacity: int = 256


@dataclass(frozen=True, slots=True)
class Keeping:
    """Data that outlive the process; by default none do.

    Attributes:
        history, events: in the store; in memory if there is none.
        ratios_m_per_rad: way per angle of the motor, m/rad, per axis.
        place: where the history is, for people.
    """

    history: History | None = None
    events: EventLog | None = None
    ratios_m_per_rad: Mapping[str, float] = field(default_factory=dict)
    place: str = "in memory only: it ends with the service"
