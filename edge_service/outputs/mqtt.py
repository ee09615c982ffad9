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
from ..broker import ANSWER_S, BrokerConfig, BrokerError
from ..messages.answer import AxisAnswer
from ..messages.event import AxisCondition
from ..messages.topics import EVENT, HEALTH, PRELOAD
from . import sparkplug
from .base import (
    Events,
    Message,
    Output,
    OutputConfig,
    OutputContext,
    OutputMisconfiguredError,
    OutputUnavailableError,
)

PERIOD_S = 1.0
"""Time in which the answer about an axis is sent once at most."""
EXPIRE_S = 60
DISCOVERY = "homeassistant"
ONLINE, OFFLINE = "online", "offline"


class MqttConfig(BrokerConfig, OutputConfig):
    """`[outputs.mqtt]`.

    Attributes:
        prefix: first part of the topics of JSON.
    """

    format: Literal["json", "home-assistant", "sparkplug"] = "json"
    prefix: str = "feeddrive"

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
        self._node = None
        if config.format == "sparkplug":
            self._node = sparkplug.Sparkplug(context.site, context.machine)
        try:
            config.tls()
        except BrokerError as error:
            raise OutputMisconfiguredError(error.key, error.problem) from None
        self._client: aiomqtt.Client | None = None
        self._listening: asyncio.Task[None] | None = None
        self._sent_s: dict[str, float] = {}

    async def open(self) -> None:
        """Connect, and say that we are there."""
        if self._client is not None:
            return
        client = self._new_client()
        try:
            await client.__aenter__()
        except aiomqtt.MqttError as error:
            raise OutputUnavailableError(f"{self.config.where}: {error}") from None
        self._client = client
        self._sent_s.clear()
        if self._node is not None:
            await self._subscribe(self._node.commands)
            await self._publish(*self._node.birth(), qos=0)
            return
        if self.config.format == "home-assistant":
            await self._subscribe(f"{DISCOVERY}/device/+/config")
            for axis in self.context.axes:
                await self._publish(*self._description(axis), retain=True)
        await self._publish(f"{self._root}/status", ONLINE, retain=True)

    async def take(self, message: Message) -> None:
        """Send an answer, once in a period, or an event."""
        if self._client is None:
            raise OutputUnavailableError("not open")
        if self._listening is not None and self._listening.done():
            await self._lost("the connection broke")
        if isinstance(message, Events):
            for event in message.events:
                if self._node is not None:
                    content = sparkplug.flat("event", event.model_dump(mode="json"))
                    await self._tell_device(event.axis, content)
                else:
                    content = {"schema": EVENT.schema} | event.model_dump(mode="json")
                    await self._publish(f"{self._root}/{event.axis or 'event'}/event", content)
            return
        axis, now_s = message.axis, time.monotonic()
        if now_s - self._sent_s.get(axis, -PERIOD_S) < PERIOD_S:
            return
        preload, health = preload_of(message), health_of(message)
        if self._node is None:
            await self._publish(f"{self._root}/{axis}/{PRELOAD.name}", preload, retain=True)
            await self._publish(f"{self._root}/{axis}/{HEALTH.name}", health, retain=True)
        elif message.is_heard:
            values = sparkplug.flat("preload", preload) | sparkplug.flat("health", health)
            await self._tell_device(axis, values)
        else:
            await self._tell_device(axis, None)
        self._sent_s[axis] = now_s

    async def close(self) -> None:
        """Say that we are gone, and disconnect."""
        client = self._client
        if client is not None:
            with suppress(OutputUnavailableError, TimeoutError):
                async with asyncio.timeout(ANSWER_S):
                    if self._node is not None:
                        await self._publish(*self._node.death())
                    else:
                        await self._publish(f"{self._root}/status", OFFLINE, retain=True)
        await self._disconnect()

    def _new_client(self) -> aiomqtt.Client:
        """A client with our will; that of a test has a name of its own, and no will."""
        topic, payload = f"{self._root}/status", OFFLINE.encode()
        if self._node is not None:
            topic, payload = self._node.will()
        will = aiomqtt.Will(topic, payload, 1, self._node is None)
        identifier = f"edge-service-{self.context.site}-{self.context.machine}"
        name = self.context.name
        client: aiomqtt.Client = self.config.client(
            f"{identifier}-test" if self.context.is_test else f"{identifier}-{name}",
            will=None if self.context.is_test else will,
        )
        return client

    async def _publish(
        self, topic: str, content: Any, qos: int = 1, *, retain: bool = False
    ) -> None:
        """Send what is text, bytes or JSON; returns when the broker has it."""
        client = self._client
        if client is None:
            raise OutputUnavailableError("not open")
        payload = json.dumps(content) if isinstance(content, dict) else content
        try:
            await client.publish(topic, payload, qos=qos, retain=retain)
        except aiomqtt.MqttError as error:
            await self._lost(str(error))

    async def _subscribe(self, topic: str) -> None:
        """Listen to what others say to us."""
        assert self._client is not None
        try:
            await self._client.subscribe(topic, qos=1)
        except aiomqtt.MqttError as error:
            await self._lost(str(error))
        self._listening = asyncio.create_task(self._listen(self._client))

    async def _listen(self, client: aiomqtt.Client) -> None:
        """Be born again when somebody asks; take back descriptions of axes that are gone."""
        begin = f"edge-service/{self._machine}/"
        with suppress(aiomqtt.MqttError, OutputUnavailableError):
            async for heard in client.messages:
                payload = heard.payload if isinstance(heard.payload, bytes) else b""
                if self._node is not None:
                    if sparkplug.asks_for_birth(payload):
                        await self._publish(*self._node.birth(), qos=0)
                        self._sent_s.clear()
                    continue
                with suppress(ValueError, KeyError, TypeError, RecursionError):
                    (name, *_) = json.loads(payload)["device"]["identifiers"]
                    if name.startswith(begin) and name[len(begin) :] not in self.context.axes:
                        await self._publish(str(heard.topic), "", retain=True)

    async def _tell_device(self, axis: str, values: dict[str, Any] | None) -> None:
        assert self._node is not None
        for topic, payload in self._node.device(axis, values):
            await self._publish(topic, payload, qos=0)

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
        for member, (topic, template, facts) in COMPONENTS.items():
            components[member] = facts | {
                "unique_id": f"{place}_{member}",
                "state_topic": f"{self._root}/{axis}/{topic}",
                "value_template": template,
                "expire_after": EXPIRE_S,
            }
        components["problem"] |= {
            "json_attributes_topic": f"{self._root}/{axis}/{HEALTH.name}",
            "json_attributes_template": _ATTRIBUTES,
        }
        device = {"identifiers": [name], "name": f"{self._machine} {axis}", "model": "Ball screw"}
        return f"{DISCOVERY}/device/{place}/config", {
            "device": device | {"manufacturer": "edge-service", "sw_version": __version__},
            "origin": {"name": "edge-service", "sw_version": __version__},
            "components": components,
            "availability": [
                {
                    "topic": f"{self._root}/status",
                    "payload_available": ONLINE,
                    "payload_not_available": OFFLINE,
                }
            ],
            "qos": 1,
        }


def preload_of(answer: AxisAnswer) -> dict[str, Any]:
    """Members of the message `preload`: that of the bus, as it may be read now."""
    return {
        "schema": PRELOAD.schema,
        **({} if answer.header is None else asdict(answer.header)),
        **answer.preload().model_dump(mode="json", exclude={"age_s"}),
    }


def health_of(answer: AxisAnswer) -> dict[str, Any]:
    """Members of the message `health`: that of the bus, as it may be read now."""
    members = answer.health.model_dump(mode="json", exclude={"friction"})
    return {"schema": HEALTH.schema} | members


def _of_fresh(bound: str) -> str:
    return f"{{{{ value_json.of_fresh.{bound} | round(2) if value_json.of_fresh else None }}}}"


_PERCENT = {
    "platform": "sensor",
    "unit_of_measurement": "%",
    "state_class": "measurement",
    "suggested_display_precision": 0,
}
_DIAGNOSTIC = {"entity_category": "diagnostic"}
_CONDITIONS = [each.value for each in AxisCondition if each is not AxisCondition.UNAVAILABLE]
_KNOWN = "value_json.condition != 'UNAVAILABLE'"
COMPONENTS: dict[str, tuple[str, str, dict[str, Any]]] = {
    "preload": ("preload", _of_fresh("value"), _PERCENT | {"name": "Preload"}),
    "preload_low": (
        "preload",
        _of_fresh("low"),
        _PERCENT | _DIAGNOSTIC | {"name": "Preload, lower bound"},
    ),
    "preload_high": (
        "preload",
        _of_fresh("high"),
        _PERCENT | _DIAGNOSTIC | {"name": "Preload, upper bound"},
    ),
    "condition": (
        "health",
        f"{{{{ value_json.condition if {_KNOWN} else None }}}}",
        {
            "platform": "sensor",
            "name": "Condition",
            "device_class": "enum",
            "options": _CONDITIONS,
        },
    ),
    "headline": (
        "health",
        "{{ value_json.headline.text[:255] if value_json.headline else None }}",
        {"platform": "sensor", "name": "Headline"},
    ),
    "advice": (
        "health",
        "{{ value_json.advice[0].text[:255] if value_json.advice else None }}",
        {"platform": "sensor", "name": "To do"},
    ),
    "next_limit": (
        "health",
        "{{ value_json.next_limit.earliest if value_json.next_limit else None }}",
        {"platform": "sensor", "name": "Next limit, earliest", "device_class": "timestamp"},
    ),
    "problem": (
        "health",
        "{{ 'ON' if value_json.alarms | selectattr('active') | list"
        f" else 'OFF' if {_KNOWN} else None }}}}",
        {"platform": "binary_sensor", "name": "Problem", "device_class": "problem"},
    ),
}
"""Values of an axis for Home Assistant: topic, template, and facts about each."""
_ATTRIBUTES = (
    "{ {% for alarm in value_json.alarms | selectattr('active') %}"
    '"{{ alarm.alarm }}": {{ alarm.text | tojson }}{{ "," if not loop.last }}'
    "{% endfor %} }"
)
"""Words of each active alarm, by its kind."""
