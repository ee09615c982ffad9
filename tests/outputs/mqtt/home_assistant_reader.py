"""Home Assistant as far as its documents tell: what it accepts, and what it then shows.

Written from https://www.home-assistant.io/integrations/mqtt/ (discovery), /sensor.mqtt/ and
/binary_sensor.mqtt/; it knows no word of the service.
"""

import asyncio
import json
import re
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import aiomqtt
from jinja2.sandbox import SandboxedEnvironment

TOPIC = re.compile(r"homeassistant/device/(?:[a-zA-Z0-9_-]+/)?([a-zA-Z0-9_-]+)/config")
ROOT = {"device", "origin", "components", "state_topic", "availability", "availability_mode"}
ROOT |= {"qos", "encoding", "command_topic"}
DEVICE = {"identifiers", "connections", "name", "manufacturer", "model", "model_id", "sw_version"}
DEVICE |= {"hw_version", "serial_number", "suggested_area", "via_device", "configuration_url"}
ENTITY = {"platform", "name", "unique_id", "device_class", "entity_category", "value_template"}
ENTITY |= {"expire_after", "icon", "json_attributes_topic", "json_attributes_template"}
ENTITY |= {"enabled_by_default", "force_update", "state_topic", "qos"}
OF_PLATFORM = {
    "sensor": {"unit_of_measurement", "state_class", "suggested_display_precision", "options"},
    "binary_sensor": {"payload_on", "payload_off", "off_delay"},
}
CLASSES = {"sensor": {None, "enum", "timestamp"}, "binary_sensor": {None, "problem"}}
UNKNOWN, UNAVAILABLE = "unknown", "unavailable"
_templates = SandboxedEnvironment()


class RefusedError(Exception):
    """A description that Home Assistant would not take."""


def _only(found: dict[str, Any], known: set[str], needed: set[str], where: str) -> None:
    if not set(found) <= known or not needed <= set(found):
        raise RefusedError(f"{where}: {sorted(set(found) ^ needed)}")


def check(description: dict[str, Any]) -> None:
    """Check a description by the schema. Raises RefusedError."""
    _only(description, ROOT, {"device", "origin", "components"}, "description")
    _only(description["device"], DEVICE, set(), "device")
    if not (description["device"].get("identifiers") or description["device"].get("connections")):
        raise RefusedError("device: nothing identifies it")
    _only(description["origin"], {"name", "sw_version", "support_url"}, {"name"}, "origin")
    for each in description.get("availability", ()):
        _only(
            each,
            {"topic", "payload_available", "payload_not_available", "value_template"},
            {"topic"},
            "availability",
        )
    for key, component in description["components"].items():
        platform = component.get("platform")
        if platform not in OF_PLATFORM:
            raise RefusedError(f"{key}: platform {platform!r}")
        _only(component, ENTITY | OF_PLATFORM[platform], {"platform", "unique_id"}, key)
        kind = component.get("device_class")
        if kind not in CLASSES[platform]:
            raise RefusedError(f"{key}: device_class {kind!r}")
        if ("options" in component) != (kind == "enum") or (kind and "state_class" in component):
            raise RefusedError(f"{key}: options and state_class do not go with {kind!r}")
        if component.get("entity_category") not in (None, "diagnostic", "config"):
            raise RefusedError(f"{key}: entity_category")
        if type(component.get("expire_after", 0)) is not int:
            raise RefusedError(f"{key}: expire_after")


def shown(component: dict[str, Any], payload: bytes) -> Any:
    """State that an entity shows for a payload of its state topic."""
    template = _templates.from_string(component["value_template"])
    value = template.render(value_json=json.loads(payload), value=payload.decode())
    if value == "None":
        return UNKNOWN
    if len(value) > 255:
        raise RefusedError("a state is longer than 255 letters")
    if component["platform"] == "binary_sensor":
        return {"ON": "on", "OFF": "off"}[value]
    if "unit_of_measurement" in component:
        return float(value)
    if component.get("device_class") == "timestamp":
        assert datetime.fromisoformat(value).tzinfo is not None
    if component.get("device_class") == "enum" and value not in component["options"]:
        raise RefusedError(f"{value!r} is none of the options")
    return value


@dataclass
class HomeAssistant:
    """Devices that were discovered, and what has come on their topics."""

    descriptions: dict[str, dict[str, Any]] = field(default_factory=dict)  # by topic
    # the last one by topic; of topics without one there is none
    payloads: dict[str, bytes] = field(default_factory=dict)
    refused: list[str] = field(default_factory=list)  # what was wrong with descriptions

    def devices(self) -> dict[str, dict[str, Any]]:
        """States of the entities of each device, by the device's name and the component."""
        return {each["device"]["name"]: self._states(each) for each in self.descriptions.values()}

    def attributes(self, device: str, component: str) -> dict[str, Any]:
        (said,) = (e for e in self.descriptions.values() if e["device"]["name"] == device)
        entity = said["components"][component]
        payload = json.loads(self.payloads[entity["json_attributes_topic"]])
        template = _templates.from_string(entity["json_attributes_template"])
        found = json.loads(template.render(value_json=payload))
        assert isinstance(found, dict)
        return found

    def _states(self, said: dict[str, Any]) -> dict[str, Any]:
        for each in said.get("availability", ()):
            told = self.payloads.get(each["topic"], b"").decode()
            if told != each.get("payload_available", "online"):
                return dict.fromkeys(said["components"], UNAVAILABLE)
        states = {}
        for key, each in said["components"].items():
            payload = self.payloads.get(each.get("state_topic", said.get("state_topic")))
            states[key] = UNKNOWN if payload is None else shown(each, payload)
        return states

    def take(self, topic: str, payload: bytes) -> None:
        if payload:
            self.payloads[topic] = payload
        else:
            self.payloads.pop(topic, None)
        if not TOPIC.fullmatch(topic):
            return
        self.descriptions.pop(topic, None)
        if payload:
            try:
                said = json.loads(payload)
                check(said)
                self.descriptions[topic] = said
            except (RefusedError, ValueError, TypeError, AttributeError) as error:
                self.refused.append(f"{topic}: {error}")


@asynccontextmanager
async def home_assistant(port: int) -> AsyncIterator[HomeAssistant]:
    """Home Assistant beside a broker for as long as the context lasts."""
    home = HomeAssistant()

    async with aiomqtt.Client("127.0.0.1", port) as client:

        async def listen() -> None:
            async for message in client.messages:
                assert isinstance(message.payload, bytes)
                home.take(str(message.topic), message.payload)

        await client.subscribe("#", qos=1)
        task = asyncio.create_task(listen())
        try:
            yield home
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
    assert home.refused == []
