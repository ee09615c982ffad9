"""Estimates, health and events off the bus, over a spool on disk, to an MQTT broker."""

import logging
import time
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

from ..bus.mqtt.delivery import MqttDelivery, MqttError, MqttSettings
from ..bus.mqtt.home_assistant import HomeAssistant
from ..bus.mqtt.packet import GONE, PayloadForm
from ..bus.mqtt.plain_json import PlainJson
from ..bus.mqtt.sparkplug import Sparkplug
from ..bus.spool.spool import Spool
from ..config import ConfigError, EdgeConfig
from ..config_tables import MqttConfig
from ..messages.header import Header
from ..messages.topics import EVENT, HEALTH, PRELOAD, Topic
from .outputs.missed import MissedEvents
from .outputs.report import OutputReport
from .supervision.heartbeat import Heartbeat
from .wiring.context import NodeContext
from .wiring.stages import load_machines

_ABSENCE_PERIOD_S = 0.5
log = logging.getLogger(__name__)
SENT: tuple[Topic[Any], ...] = (PRELOAD, HEALTH, EVENT)


async def run(context: NodeContext) -> None:
    """Send until cancelled. Raises ConfigError for what cannot work."""
    config = context.config
    if config.mqtt is None:
        raise ConfigError("mqtt: missing; the node needs a [mqtt] table with a host")
    report = OutputReport(context, "mqtt")
    most, most_bytes = config.mqtt.buffer_messages, round(1e6 * config.mqtt.buffer_mb)
    opening = Spool.open(config.mqtt.buffer, most, most_bytes)
    spool = await context.heart.patiently(opening)
    try:
        delivery = MqttDelivery(
            _settings(context, config.mqtt),
            _form(config, config.mqtt),
            spool,
            report.tell,
        )
    except MqttError as error:
        spool.close()
        raise ConfigError(str(error)) from None
    attendance = Attendance(PRELOAD.stale_after_s)
    subscribers = [context.subscribe(topic, depth=1024) for topic in SENT]
    report.watch(
        spool,
        lambda: {
            "delivered": delivery.delivered,
            "connections": delivery.connections,
            "waiting": len(spool),
        },
    )
    missed = MissedEvents(context.events, spool, (axis.name for axis in config.axes))
    try:
        context.spools["mqtt"] = spool
        await context.heart.patiently(missed.put())
        async with report.running() as tasks:
            tasks.start("delivery", partial(_deliver, delivery, spool))
            for topic, subscriber in zip(SENT, subscribers, strict=True):
                take = _taker(config.mqtt, spool, topic, attendance, missed)
                tasks.follow(topic.name, subscriber, take)
            tasks.repeat("absence", _ABSENCE_PERIOD_S, partial(_note_absence, attendance, spool))
            await context.forever()
    finally:
        context.spools.pop("mqtt", None)
        spool.close()


def _settings(context: NodeContext, mqtt: MqttConfig) -> MqttSettings:
    service = context.config.service
    return MqttSettings(
        mqtt.host,
        mqtt.port,
        client_id=f"edge-service-{service.site}-{service.machine}",
        user=mqtt.user,
        password=mqtt.password,
        ca_certificate=mqtt.ca_certificate,
        client_certificate=mqtt.client_certificate,
        client_key=mqtt.client_key,
    )


def _form(config: EdgeConfig, mqtt: MqttConfig) -> PayloadForm:
    """Form of the payloads as configured."""
    service = config.service
    machine = f"{service.site}/{service.machine}"
    root = f"{mqtt.prefix.strip('/')}/{machine}"
    if mqtt.payload == "sparkplug":
        return Sparkplug(service.site, service.machine)
    if not mqtt.home_assistant:
        return PlainJson(root)
    fresh = {axis: each.fresh_preload_percent for axis, each in load_machines(config).items()}
    prefix = mqtt.discovery_prefix.strip("/")
    return HomeAssistant(root, machine, fresh, prefix, mqtt.period_s)


class Attendance:
    """Register of the axes that are heard, by their estimates."""

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._heard_s: dict[str, float] = {}

    def hear(self, axis: str, now_s: float) -> None:
        """Note that an axis is there."""
        self._heard_s[axis] = now_s

    def missing(self, now_s: float) -> list[str]:
        """Axes that have not been heard for too long; each is returned once."""
        gone = [axis for axis, at_s in self._heard_s.items() if now_s - at_s > self._patience_s]
        for axis in gone:
            del self._heard_s[axis]
        return gone


async def _deliver(delivery: MqttDelivery, spool: Spool, heart: Heartbeat) -> None:
    with heart.idle(lambda: delivery.waits and len(spool) == 0):
        await delivery.run(heart)


def _taker(
    mqtt: MqttConfig,
    spool: Spool,
    topic: Topic[Any],
    attendance: Attendance,
    missed: MissedEvents,
) -> Callable[[str, Header, Any], Coroutine[Any, Any, None]]:
    """Put payloads into the spool; estimates not more often than asked for."""
    period_ns = round(1e9 * mqtt.period_s) if topic is PRELOAD else 0
    sent_ns: dict[str, int] = {}

    async def take(axis: str, header: Header, payload: Any) -> None:
        if topic is PRELOAD:
            attendance.hear(axis, time.monotonic())
        if 0 <= header.source_time_ns - sent_ns.get(axis, -period_ns) < period_ns:
            return
        sent_ns[axis] = header.source_time_ns
        said = topic.encode(axis, header, payload)
        number = await missed.number(payload) if topic is EVENT else 0
        await spool.put(f"{axis}/{topic.name}", said, mark=number)

    return take


async def _note_absence(attendance: Attendance, spool: Spool) -> None:
    """Put a note into the spool for each axis that has fallen silent."""
    for axis in attendance.missing(time.monotonic()):
        await spool.put(f"{axis}/{GONE}", b"")
