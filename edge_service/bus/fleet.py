"""Condition of every axis that machines put at a Zenoh router of the plant."""

import json
import os
import threading
import time
from dataclasses import dataclass

import zenoh
from zenoh import ext

from ..clock import now_ns
from ..messages.codec import parse_bounded
from ..messages.health import AxisHealth
from ..messages.keys import ROOT
from ..messages.topics import HEALTH

_KEYS = f"{ROOT}/*/*/*/{HEALTH.name}"
_PUBLISHERS = f"{_KEYS}/@adv/**"
"""Liveliness tokens of the publishers, one an axis."""


class RouterAwayError(Exception):
    """A router cannot be joined now; the text says why."""


@dataclass(slots=True)
class HeardAxis:
    """The last word on one axis."""

    site: str
    machine: str
    axis: str
    there: bool = False  # its publisher shows presence
    payload: bytes | None = None  # of the last message; None before the first
    arrival_s: float = 0.0  # when that came, monotonic, s
    is_new: bool = False  # it is known to tell of now, and not of a time before it was cached

    @property
    def health(self) -> AxisHealth | None:
        """Health that tells how the axis is now; members of later versions are left unread."""
        silent = time.monotonic() - self.arrival_s > HEALTH.stale_after_s
        if silent or self.payload is None or not (self.there and self.is_new):
            return None
        try:
            return AxisHealth.model_validate(parse_bounded(self.payload), extra="ignore")
        except (ValueError, RecursionError):
            return None


class HealthListener:
    """Subscriber to the topic `health` of all machines at a router; goes on when that is back.

    The last message of each axis comes at once, from its publisher's cache. It may be old, and the
    clocks of machines may differ, so it tells of now if its time stamp is of now by our clock, or
    once a further message comes.

    Raises RouterAwayError: no router answers within 2 s.
    """

    def __init__(self, endpoint: str) -> None:
        self._axes: dict[str, HeardAxis] = {}
        self._changed = threading.Condition()
        try:
            config = zenoh.Config.from_env() if os.environ.get("ZENOH_CONFIG") else zenoh.Config()
            config.insert_json5("mode", '"client"')
            config.insert_json5("listen/endpoints", "[]")
            config.insert_json5("connect/endpoints", json.dumps([endpoint]))
            config.insert_json5("connect/timeout_ms", "2000")
            config.insert_json5("scouting/multicast/enabled", "false")
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise RouterAwayError(
                f"no Zenoh router answers: {error}".partition(" at /")[0]
            ) from None
        # before anything is declared: later it would be answered from what has come by then
        for reply in self._session.liveliness().get(_PUBLISHERS):
            if reply.ok is not None:
                self._on_presence(reply.ok)
        self._subscriber = ext.declare_advanced_subscriber(
            self._session,
            _KEYS,
            zenoh.handlers.Callback(self._on_sample, indirect=False),
            history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
            recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
        )
        called = zenoh.handlers.Callback(self._on_presence, indirect=False)
        liveliness = self._session.liveliness()
        self._presence = liveliness.declare_subscriber(_PUBLISHERS, called, history=True)

    def settle(self, timeout_s: float) -> None:
        """Wait until every axis that is there tells of now, for `timeout_s` at most."""
        with self._changed:
            self._changed.wait_for(
                lambda: all(each.is_new for each in self._axes.values() if each.there), timeout_s
            )

    def axes(self) -> list[HeardAxis]:
        """Every axis that was heard since the beginning, those that are gone included."""
        with self._changed:
            return list(self._axes.values())

    def close(self) -> None:
        """End the session."""
        self._session.close()

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh."""
        stamp_s = 0.0 if sample.timestamp is None else sample.timestamp.get_time().timestamp()
        with self._changed:
            axis = self._axis(str(sample.key_expr))
            near = abs(now_ns() / 1e9 - stamp_s) < HEALTH.stale_after_s
            axis.is_new = near or axis.payload is not None
            axis.payload, axis.arrival_s = sample.payload.to_bytes(), time.monotonic()
            self._changed.notify_all()

    def _on_presence(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh; who comes back has to tell of now anew."""
        with self._changed:
            axis = self._axis(str(sample.key_expr).partition("/@adv/")[0])
            axis.there = sample.kind == zenoh.SampleKind.PUT
            if not axis.there:
                axis.is_new, axis.payload = False, None
            self._changed.notify_all()

    def _axis(self, key: str) -> HeardAxis:
        site, machine, name = key.split("/")[2:5]
        return self._axes.setdefault(key, HeardAxis(site, machine, name))
