"""JSON off an MQTT broker: messages in, rows of samples out."""

import asyncio
import hashlib
import logging
import socket
import time
from collections.abc import AsyncGenerator
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import aiomqtt
import numpy as np

from edge_service.messages.samples import SampleFrame
from edge_service.recordings.sinumerik.edge import HEADER
from edge_service.recordings.sinumerik.signals import ControllerAxis

from ..base import DriverConfig, DriverContext, DriverUnavailableError, Probe
from ..rows import LARGEST_FRAME, QualityCounts
from .link import MqttLink, MqttSourceConfig
from .mapped import MappedStream
from .streams import EdgeStream, Lateness, MessageError, decode_object

log = logging.getLogger(__name__)
LISTEN_S = 10.0  # longest time that a probe listens
MOST_TOPICS = 5
BRIEF_S, MOST_BRIEF = 20.0, 3
"""So many connections in a row that last no longer: another client has our name."""
INSTALLATION = Path("/etc/machine-id")


class MqttDriver:
    """One axis out of what one capture or device sends.

    The broker keeps what comes while the connection is away; the count of the samples tells what
    was lost all the same. Skipped and counted are messages that cannot be read, are of a topic that
    was not asked for, or were retained by the broker: nobody knows how old those are.

    Attributes:
        client_id: our name at the broker; no other installation, axis or topic has it.
        lag_s: by so much the newest samples came later than others before.
    """

    config_model: ClassVar[type[DriverConfig]] = MqttSourceConfig
    paced = True

    def __init__(self, config: MqttSourceConfig, context: DriverContext) -> None:
        self._config, self._context = config, context
        self._link: MqttLink | None = None
        self._stream = self._new_stream()
        kinds = ("messages", "malformed_messages", "foreign_messages", "retained_messages")
        self._counts = dict.fromkeys((*kinds, "connections"), 0)
        self._qualities = QualityCounts()
        self._told: set[str] = set()
        self._lateness, self.lag_s = Lateness(), 0.0
        self._opened_s, self._brief = 0.0, 0
        known = INSTALLATION.read_bytes() if INSTALLATION.is_file() else b""
        place = f"{socket.gethostname()} {context.installation} {config.address}"
        token = hashlib.sha256(known + place.encode()).hexdigest()[:8]
        names = ("edge-service", *context.service.split("/")[-2:], context.axis, token)
        self.client_id = "-".join(names)

    @property
    def counters(self) -> dict[str, int]:
        return self._counts | self._stream.counters | self._qualities.counts

    @property
    def readings(self) -> dict[str, float]:
        return self._stream.readings

    async def open(self) -> None:
        if self._link is not None and self._link.connected:
            return
        await self._leave()
        link = self._link = MqttLink(self._config, self.client_id)
        try:
            await link.connect()
            await link.subscribe(self._config.topic)
        except asyncio.CancelledError:
            raise  # `close` waits for what the library has begun
        except BaseException:
            await self._leave()
            raise
        self._counts["connections"] += 1
        self._opened_s = time.monotonic()

    async def frames(self) -> AsyncGenerator[SampleFrame, None]:
        """Frames of each message until `close`, or DriverUnavailableError."""
        link = self._link
        if link is None or not link.connected:
            raise DriverUnavailableError(f"{self._config.address}: the connection is not open")
        while True:
            try:
                message = await link.next()
            except DriverUnavailableError as error:
                raise self._explained(error) from None
            if message is None or self._link is not link:
                return
            self._counts["messages"] += 1
            try:
                frames = self._heard(message, self._stream)
            except MessageError as error:
                self._counts[error.counter] += 1
                kind = str(error).split("(", maxsplit=1)[0][:40]
                if kind not in self._told and len(self._told) < 20:  # each kind is logged once
                    self._told.add(kind)
                    line = " ".join(str(error).split())[:200]
                    log.warning("%s: a message is skipped: %s", self._config.address, line)
                continue
            for frame in map(self._qualities.count, frames):
                run = self._stream.counters["restarts"]
                self.lag_s = self._lateness.lag_s(float(frame.time_s[-1]), run)
                for start in range(0, len(frame), LARGEST_FRAME):
                    yield frame.part(slice(start, start + LARGEST_FRAME))

    async def probe(self) -> Probe:
        """Listen until two samples are heard. Raises like `open`, and says what came instead."""
        link, stream = MqttLink(self._config, None), self._new_stream()
        topics: dict[str, str] = {}
        times_s: list[float] = []
        try:
            await link.connect()
            await link.subscribe(self._config.topic)
            with suppress(TimeoutError):
                async with asyncio.timeout(LISTEN_S):
                    while len(times_s) < 2 and (message := await link.next()) is not None:
                        problem = ""
                        try:
                            for frame in self._heard(message, stream):
                                times_s += frame.time_s.tolist()
                        except MessageError as error:
                            problem = str(error)
                        if len(topics) < MOST_TOPICS:
                            topics[str(message.topic)[:80]] = problem
        finally:
            await link.close()
        if not times_s:
            each = [f"{topic} ({problem or 'no samples'})" for topic, problem in topics.items()]
            heard = f"heard, but nothing that can be read: {', '.join(each)}"[:600]
            nothing = f"nothing was heard in {LISTEN_S:g} s"
            raise DriverUnavailableError(f"{self._config.address}: {heard if each else nothing}")
        steps_s = np.diff(times_s)
        rate_hz = float(1.0 / np.median(steps_s)) if (steps_s > 0.0).any() else None
        described = f"MQTT {self._config.address}, samples on {', '.join(topics)}"
        return Probe(described, stream.channels, rate_hz)

    async def close(self) -> None:
        await self._leave()
        self._stream, self._lateness = self._new_stream(), Lateness()

    def _heard(
        self, message: aiomqtt.Message, stream: EdgeStream | MappedStream
    ) -> list[SampleFrame]:
        """Frames of a message. Raises MessageError, and what streams raise."""
        unwanted = MessageError(f"nobody asked for its topic ({message.topic})")
        unwanted.counter = "foreign_messages"
        if message.topic.matches(self._config.topic):
            content = decode_object(message.payload)
            if not message.retain:
                return stream.frames(content)
            if isinstance(stream, EdgeStream):
                stream.frames({HEADER: content.get(HEADER)})
            unwanted = MessageError("retained by the broker, of unknown age")
            unwanted.counter = "retained_messages"
        raise unwanted

    def _explained(self, loss: DriverUnavailableError) -> DriverUnavailableError:
        """The loss of a connection, with the likely reason where it is lost again and again."""
        is_brief = time.monotonic() - self._opened_s < BRIEF_S
        self._brief = self._brief + 1 if is_brief else 0
        if self._brief < MOST_BRIEF:
            return loss
        return DriverUnavailableError(f"{loss}; another client seems to be {self.client_id}, too")

    def _new_stream(self) -> EdgeStream | MappedStream:
        config, machine = self._config, self._context.machine
        if config.signals:
            return MappedStream(config, machine)
        axis = ControllerAxis(machine.axis.number, machine.axis.lead_m)
        return EdgeStream(config.address, machine.columns, axis)

    async def _leave(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            await link.close()
