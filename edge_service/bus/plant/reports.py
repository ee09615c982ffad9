"""Reports of the machines in some parts of a plant: each once, in order, from its own key."""

import asyncio
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Collection
from dataclasses import dataclass
from typing import Any

import zenoh
from zenoh.ext import AdvancedSubscriber, HistoryConfig, Miss, RecoveryConfig
from zenoh.ext import declare_advanced_subscriber as declare

from ...messages.codec.interface import CodecError
from ...messages.header import Header
from ...messages.names import check_part
from ...messages.plant import MOST_REPORT_BYTES, REPORT, MachineReport, PlantKeys, bucket_reports
from ..refusals import Refusal, Refusals
from ..rings import Arrival, KeyRings
from ..sender import Sender

MOST_KEYS = 20_000
"""Machines that one reader hears at most."""
MOST_HZ, BURST = 50.0, 2000.0
"""Reports of one machine: for long, and at once, as they come when a router is back."""
DEPTH = 2000
PATIENCE_S = 1.25
"""Silence of a machine's publisher after which another one, of the same machine, is heard."""
_TURN = 32
_PUBLISHER = "/@adv/"


@dataclass(frozen=True, slots=True)
class Heard:
    """One report, and how many of its machine were lost before it; starts of the machine."""

    header: Header
    report: MachineReport
    lost: int
    restarts: int


@dataclass(frozen=True, slots=True)
class Seen:
    """Presence of a machine's publisher: it has come, or gone."""

    site: str
    machine: str
    present: bool


class PlantReports:
    """An asynchronous iterator of what is heard in the parts of the plant that are read.

    Reports that were lost on the way are asked for again, and the last ones of machines that were
    there before come at once: both are Zenoh's (`AdvancedSubscriber`). Of a machine that comes
    later all is heard from the first report that arrives.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self.refusals = Refusals()
        self.received = self.missed = 0
        self.buckets: frozenset[int] = frozenset()
        """Parts that are read."""
        self._session = session
        self._loop = asyncio.get_running_loop()
        self._rings = KeyRings(DEPTH, MOST_HZ, BURST, MOST_KEYS)
        self._seen: deque[tuple[str, bool]] = deque()
        self._publishers: Counter[PlantKeys] = Counter()
        self._senders: dict[str, Sender] = {}
        self._subscribers: dict[int, tuple[AdvancedSubscriber[Any], list[Any]]] = {}
        self._wake = asyncio.Event()
        self._waiting = False

    @property
    def is_idle(self) -> bool:
        """True while somebody waits and there is nothing."""
        return self._waiting and not self._rings and not self._seen

    def counts(self) -> dict[str, int]:
        """Counts so far, by name."""
        return {
            "received": self.received,
            "missed": self.missed,
            "ring_overruns": self._rings.overruns,
            "refused": self.refusals.counts().total(),
        }

    def aim(self, buckets: Collection[int]) -> None:
        """Mean these parts of the plant from now on, and no others; `follow` does it."""
        left = self.buckets - frozenset(buckets)
        self.buckets = frozenset(buckets)
        for key in [key for key in self._senders if _bucket_of(key) in left]:
            del self._senders[key]  # what others read meanwhile is no loss
        for keys in [keys for keys in self._publishers if keys.bucket in left]:
            del self._publishers[keys]

    def follow(self) -> None:
        """Read what is meant, for which Zenoh may take a while: to be called in a thread."""
        for bucket in [each for each in self._subscribers if each not in self.buckets]:
            subscriber, listeners = self._subscribers.pop(bucket)
            for each in (*listeners, subscriber):
                each.undeclare()
        for bucket in sorted(self.buckets):
            if bucket not in self._subscribers:
                self._enter(bucket)

    def close(self) -> None:
        """Read nothing any more; safe twice."""
        self.aim(())
        self.follow()

    def _enter(self, bucket: int) -> None:
        subscriber = declare(
            self._session,
            bucket_reports(bucket),
            zenoh.handlers.Callback(self._on_sample, indirect=False),
            # not detect_late_publishers: of a publisher that is back it would take the last report
            # and give up those before it, which heartbeat fetches
            history=HistoryConfig(max_samples=1),
            recovery=RecoveryConfig(heartbeat=True, periodic_queries=None),
        )
        listeners: list[Any] = [
            subscriber.detect_publishers(
                zenoh.handlers.Callback(self._on_publisher, indirect=False), history=True
            ),
            subscriber.sample_miss_listener(zenoh.handlers.Callback(self._on_miss, indirect=False)),
        ]
        self._subscribers[bucket] = subscriber, listeners

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh."""
        key, now_s = str(sample.key_expr), time.monotonic()
        self.received += 1
        refusal = self._refusal(key, len(sample.payload), now_s)
        if refusal is not None:
            self.refusals.add(key, refusal)
            return
        self._rings.put(Arrival(key, sample.payload.to_bytes(), now_s))
        self._call()

    def _refusal(self, key: str, size: int, now_s: float) -> Refusal | None:
        if not self._rings.knows(key):
            return Refusal.FOREIGN
        if size > MOST_REPORT_BYTES:
            return Refusal.OVERSIZED
        return None if self._rings.admits(key, now_s) else Refusal.FLOODED

    def _on_publisher(self, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if _PUBLISHER in key:
            self._seen.append((key, sample.kind == zenoh.SampleKind.PUT))
            self._call()

    def _on_miss(self, miss: Miss) -> None:
        self.missed += miss.nb

    def _call(self) -> None:
        if self._waiting and not self._loop.is_closed():
            self._waiting = False
            self._loop.call_soon_threadsafe(self._wake.set)

    async def __aiter__(self) -> AsyncIterator[Heard | Seen]:
        turns = 0
        while True:
            while self._seen or self._rings:
                heard = self._next()
                if heard is not None:
                    yield heard
                turns += 1
                if turns % _TURN == 0:
                    await asyncio.sleep(0)
            self._wake.clear()
            self._waiting = True  # before the last look: the other thread appends, then asks
            if not self._rings and not self._seen:
                await self._wake.wait()
            self._waiting = False

    def _next(self) -> Heard | Seen | None:
        if self._seen:
            return self._presence(*self._seen.popleft())
        arrival = self._rings.take()
        if arrival is None:
            return None
        if _bucket_of(arrival.key) not in self.buckets:
            return None
        heard = self._heard(arrival)
        if isinstance(heard, Refusal):
            self.refusals.add(arrival.key, heard)
            return None
        return heard

    def _presence(self, key: str, come: bool) -> Seen | None:
        keys = _machine_of(key.partition(_PUBLISHER)[0])
        if keys is None or keys.bucket not in self.buckets:
            return None
        self._publishers[keys] = max(self._publishers[keys] + (1 if come else -1), 0)
        return Seen(keys.site, keys.machine, self._publishers[keys] > 0)

    def _heard(self, arrival: Arrival) -> Heard | Refusal:
        keys = _machine_of(arrival.key)
        if keys is None:
            return Refusal.MISPLACED
        try:
            _, header, report = REPORT.decode(arrival.payload)
            for axis in report.axes:
                check_part(axis.axis)
        except (CodecError, ValueError):
            return Refusal.MALFORMED
        if (report.site, report.machine) != (keys.site, keys.machine):
            return Refusal.MISPLACED
        sender = self._senders.setdefault(arrival.key, Sender(PATIENCE_S))
        refusal = sender.judge(header, arrival.arrival_s)
        return refusal or Heard(header, report, sender.lost, sender.restarts)


def _bucket_of(key: str) -> int:
    """Part of the plant that a key of reports names; -1 if it names none."""
    number = key.removeprefix(bucket_reports(0).partition("/0/")[0]).split("/")[1]
    return int(number) if number.isdecimal() else -1


def _machine_of(key: str) -> PlantKeys | None:
    """Machine whose reports have this key; None if it is no machine's key."""
    *_, site, machine = key.split("/")
    try:
        keys = PlantKeys(check_part(site), check_part(machine))
    except ValueError:
        return None
    return keys if keys.report == key else None
