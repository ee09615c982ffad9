"""MQTT: the newest answers retained, events as they come, to any broker.

The format `home-assistant` adds the description by which Home Assistant finds each axis
(https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery); `sparkplug` sends Sparkplug B.
"""

import asyncio
import json
import re
import time
from contextlib import suppress
from dataclasses import asdict
from hashlib import sha256
from typing import Any, Literal

import aiomqtt
from pydantic import field_validator

from .. import __version__
from ..broker import ANSWER_S, BrokerConfig
from ..messages.answer import AxisAnswer
from ..messages.estimate import ImmEstimate
from ..messages.event import AxisCondition
from ..messages.topics import EVENT, HEALTH, IMM, PRELOAD
from ..retry import all_of
from . import sparkplug
from .base import Message, Output, OutputConfig, OutputContext, OutputUnavailableError

PERIOD_S, EXPIRE_S, SILENT_S = 1.0, 60, 2
"""An answer about an axis is sent once in that time at most; Home Assistant drops what is as old;
half as long again without a message, and the broker says that the service is gone."""
ONLINE, OFFLINE = "online", "offline"
_TOLD = PRELOAD.name, HEALTH.name, IMM.name


class MqttConfig(BrokerConfig, OutputConfig):
    format: Literal["json", "home-assistant", "sparkplug"] = "json"
    prefix: str = "feeddrive"  # first part of the topics of JSON

    @field_validator("prefix")
    @classmethod
    def _topic(cls, value: str) -> str:
        if any(sign in value for sign in "+#$\0") or not value.strip("/"):
            raise ValueError(f"{value!r}: expected a topic without +, # and $")
        return value.strip("/")


class MqttOutput(Output):
    """One connection to a broker."""

    config_model = MqttConfig
    receivers = ("",)

    def __init__(self, config: MqttConfig, context: OutputContext) -> None:
        super().__init__(config, context)
        self._machine = f"{context.site}/{context.machine}"
        self._root = f"{config.prefix}/{self._machine}"
        self._node: sparkplug.Sparkplug | None = None
        if config.format == "sparkplug":
            self._node = sparkplug.Sparkplug(context.site, context.machine)
        config.tls()
        self._client: aiomqtt.Client | None = None
        self._listening: asyncio.Task[None] | None = None
        self._sent_s: dict[str, float] = {}

    async def open(self) -> None:
        if self._client is not None:
            return
        client = self._new_client()
        try:
            await client.__aenter__()
        except aiomqtt.MqttError as error:
            raise OutputUnavailableError(f"{self.config.where}: {error}") from None
        self._client = client
        self._sent_s.clear()
        if self.context.is_test:  # of the service that runs nothing is said
            return
        if self._node is not None:
            try:
                await client.subscribe(self._node.commands, qos=1)
            except aiomqtt.MqttError as error:
                await self._lost(str(error))
            self._listening = asyncio.create_task(self._listen(client, self._node))
            await self._publish(*self._node.birth(), qos=0)
            return
        describes = self.config.format == "home-assistant"
        for axis in self.context.axes if describes else ():
            await self._publish(*self._description(axis), retain=True)
        for axis in self.context.gone:  # an empty message clears what is retained
            topics = [f"{self._root}/{axis}/{each}" for each in _TOLD]
            for topic in (*topics, *((self._description(axis)[0],) if describes else ())):
                await self._publish(topic, "", retain=True)
        await self._publish(f"{self._root}/status", ONLINE, retain=True)

    async def take(self, message: Message) -> None:
        if self._client is None:
            raise OutputUnavailableError("not open")
        if self._listening is not None and self._listening.done():
            await self._lost("the connection broke")
        if isinstance(message, AxisAnswer):
            if time.monotonic() < self._sent_s.get(message.axis, -PERIOD_S) + PERIOD_S:
                return
            self._sent_s[message.axis] = time.monotonic()
            answer = message.preload().model_dump(mode="json", exclude={"age_s"})
            header = {} if message.header is None else asdict(message.header)
            preload, health = {"schema": PRELOAD.schema} | header | answer, health_of(message)
            if self._node is not None:
                values = sparkplug.flat("preload", preload) | sparkplug.flat("health", health)
                await self._tell_device(message.axis, values if message.is_heard else None)
                return
            opinion = message.opinion or ImmEstimate(axis=message.axis)
            imm = {"schema": IMM.schema} | opinion.model_dump(mode="json")
            root, told = f"{self._root}/{message.axis}/", (preload, health, imm)
            said = zip(_TOLD, told, strict=True)
            await all_of(*(self._publish(root + name, each, retain=True) for name, each in said))
            return
        for event in message.events:
            members = event.model_dump(mode="json")
            if self._node is not None and self.context.is_test:
                continue  # a node that was not born says nothing
            if self._node is not None:
                await self._tell_device(event.axis, sparkplug.flat("event", members))
            else:
                topic = f"{self._root}/{event.axis or 'event'}/event"
                await self._publish(topic, {"schema": EVENT.schema} | members)

    async def close(self) -> None:
        if self._client is not None and not self.context.is_test:
            with suppress(OutputUnavailableError, TimeoutError):
                async with asyncio.timeout(ANSWER_S):
                    await self._publish(*self._death(), retain=self._node is None)
        await self._disconnect()

    async def _tell_device(self, axis: str, values: dict[str, Any] | None) -> None:
        assert self._node is not None
        for topic, payload in self._node.device(axis, values):
            await self._publish(topic, payload, qos=0)

    def _death(self) -> tuple[str, str | bytes]:
        return (f"{self._root}/status", OFFLINE) if self._node is None else self._node.death()

    def _new_client(self) -> aiomqtt.Client:
        """A client with our will; that of a test has a name of its own, and no will."""
        if self._node is not None:
            self._node.begin()
        is_test, name = self.context.is_test, self.context.name
        will = None if is_test else aiomqtt.Will(*self._death(), 1, self._node is None)
        who = f"edge-service-{self._machine.replace('/', '-')}-{'test' if is_test else name}"
        client: aiomqtt.Client = self.config.client(who, will=will, keepalive=SILENT_S)
        client.pending_calls_threshold += len(_TOLD) * len(self.context.axes)  # or it warns
        return client

    async def _publish(self, topic: str, told: Any, qos: int = 1, *, retain: bool = False) -> None:
        """Send what is text, bytes or JSON; returns when the broker has it."""
        if self._client is None:
            raise OutputUnavailableError("not open")
        payload = json.dumps(told) if isinstance(told, dict) else told
        try:
            await self._client.publish(topic, payload, qos=qos, retain=retain)
        except aiomqtt.MqttError as error:
            await self._lost(str(error))

    async def _listen(self, client: aiomqtt.Client, node: sparkplug.Sparkplug) -> None:
        """Be born again when a host asks for it."""
        with suppress(aiomqtt.MqttError, OutputUnavailableError):
            async for heard in client.messages:
                if isinstance(heard.payload, bytes) and sparkplug.asks_for_birth(heard.payload):
                    await self._publish(*node.birth(), qos=0)
                    self._sent_s.clear()

    async def _lost(self, reason: str) -> None:
        """Raise what is wrong, after the connection was given up."""
        await self._disconnect()
        raise OutputUnavailableError(f"{self.config.where}: {reason}")

    async def _disconnect(self) -> None:
        client, self._client = self._client, None
        listening, self._listening = self._listening, None
        if listening is not None and listening is not asyncio.current_task():
            listening.cancel()
        if client is not None:
            with suppress(aiomqtt.MqttError, TimeoutError):
                async with asyncio.timeout(ANSWER_S):
                    await client.__aexit__(None, None, None)

    def _description(self, axis: str) -> tuple[str, dict[str, Any]]:
        """Topic and content of the description of an axis for Home Assistant."""
        name = f"edge-service/{self._machine}/{axis}"
        place = re.sub("[^A-Za-z0-9_-]", "_", name) + "_" + sha256(name.encode()).hexdigest()[:8]
        components = {}
        for member, (shown, topic, template, facts) in COMPONENTS.items():
            components[member] = facts | {
                "name": shown,
                "unique_id": f"{place}_{member}",
                "state_topic": f"{self._root}/{axis}/{topic}",
                "value_template": f"{{{{ {template} }}}}",
                "expire_after": EXPIRE_S,
            }
        components["problem"] |= {
            "json_attributes_topic": f"{self._root}/{axis}/{HEALTH.name}",
            "json_attributes_template": _ATTRIBUTES,
        }
        device = {"identifiers": [name], "name": f"{self._machine} {axis}", "model": "Ball screw"}
        status = {"topic": f"{self._root}/status", "payload_available": ONLINE}
        return f"homeassistant/device/{place}/config", {
            "device": device | {"manufacturer": "edge-service", "sw_version": __version__},
            "origin": {"name": "edge-service", "sw_version": __version__},
            "components": components,
            "availability": [status | {"payload_not_available": OFFLINE}],
            "qos": 1,
        }


def health_of(answer: AxisAnswer) -> dict[str, Any]:
    """Members of the message `health`: that of the bus, as it may be read now."""
    members = answer.health.model_dump(mode="json", exclude={"friction"})
    return {"schema": HEALTH.schema} | members


def _of_fresh(bound: str) -> str:
    return f"value_json.of_fresh.{bound} | round(2) if value_json.of_fresh else None"


def _of(member: str, inside: str) -> str:
    return f"value_json.{member}{inside} if value_json.{member} else None"


_SENSOR = {"platform": "sensor"}
_PERCENT = _SENSOR | {
    "unit_of_measurement": "%",
    "state_class": "measurement",
    "suggested_display_precision": 0,
}
_BOUND = _PERCENT | {"entity_category": "diagnostic"}
_CONDITIONS = [each.value for each in AxisCondition if each is not AxisCondition.UNAVAILABLE]
_KNOWN = "value_json.condition != 'UNAVAILABLE'"
_ALARMS = "value_json.alarms | selectattr('active')"
COMPONENTS: dict[str, tuple[str, str, str, dict[str, Any]]] = {
    "preload": ("Preload", "preload", _of_fresh("value"), _PERCENT),
    "preload_low": ("Preload, lower bound", "preload", _of_fresh("low"), _BOUND),
    "preload_high": ("Preload, upper bound", "preload", _of_fresh("high"), _BOUND),
    "condition": (
        "Condition",
        "health",
        f"value_json.condition if {_KNOWN} else None",
        _SENSOR | {"device_class": "enum", "options": _CONDITIONS},
    ),
    "headline": ("Headline", "health", _of("headline", ".text[:255]"), _SENSOR),
    "advice": ("To do", "health", _of("advice", "[0].text[:255]"), _SENSOR),
    "next_limit": (
        "Next limit, earliest",
        "health",
        _of("next_limit", ".earliest"),
        _SENSOR | {"device_class": "timestamp"},
    ),
    "problem": (
        "Problem",
        "health",
        f"'ON' if {_ALARMS} | list else 'OFF' if {_KNOWN} else None",
        {"platform": "binary_sensor", "device_class": "problem"},
    ),
}
"""Values of an axis for Home Assistant: name, topic, template, and facts about each."""
_ATTRIBUTES = (
    f"{{ {{% for alarm in {_ALARMS} %}}"
    '"{{ alarm.alarm }}": {{ alarm.text | tojson }}{{ "," if not loop.last }}'
    "{% endfor %} }"
)
"""Words of each active alarm, by its kind."""
