"""Home Assistant: JSON as before, and each axis as a device that it discovers by itself.

Source: https://www.home-assistant.io/integrations/mqtt/#mqtt-discovery (device discovery).
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from ..spool.message import Message
from .device_state import DeviceState, axis_of_identifier, discovery, identifier, object_id
from .packet import GONE, Packet
from .plain_json import PlainJson

PATIENCE_S = 60.0
"""Time without a state after which nothing is shown; longer where estimates are rare."""


class HomeAssistant(PlainJson):
    """Plain JSON, with a description and a state of each axis, both retained.

    A state holds what has come in this connection only; null is unknown. What waited on disk is
    old, and changes no state. Descriptions of axes that are no longer configured are taken back.

    Args:
        root: of the topics, `{prefix}/{site}/{machine}`.
        machine: `{site}/{machine}`.
        fresh_percent: preload of each axis' fresh screw, percent of the load rating.
        prefix: under which Home Assistant looks for descriptions.
        period_s: between two estimates at most.
    """

    def __init__(
        self,
        root: str,
        machine: str,
        fresh_percent: Mapping[str, float | None],
        prefix: str,
        period_s: float,
    ) -> None:
        super().__init__(root)
        self._machine, self._fresh = machine, dict(fresh_percent)
        self._prefix, self._patience_s = prefix, max(PATIENCE_S, 3.0 * period_s)
        self._states: dict[str, DeviceState] = {}
        self.described = f"{prefix}/device/+/config"

    def greeting(self, newest: Mapping[str, Message]) -> list[Packet]:
        """Nothing is known yet; then who we are, and that we are there."""
        self._states = {axis: DeviceState(fresh) for axis, fresh in self._fresh.items()}
        states = [self._state(axis) for axis in self._states]
        described = [self._description(axis) for axis in self._fresh]
        return [*states, *described, *super().greeting(newest)]

    def packets(self, message: Message, newest: Mapping[str, Message], late: bool) -> list[Packet]:
        """The payload, and the state that it leads to."""
        packets = super().packets(message, newest, late)
        axis, _, topic = message.topic.partition("/")
        state = self._states.get(axis)
        if state is None or late:
            return packets
        known = state.forget() if topic == GONE else state.take(topic, message.payload)
        return [*packets, self._state(axis)] if known else packets

    def outdated(self, topic: str, payload: bytes) -> Sequence[Packet]:
        """Packets that take back what was said of an axis that is no longer configured."""
        axis = axis_of_identifier(self._machine, _identifiers(payload))
        if axis is None or axis in self._fresh:
            return ()
        return [
            Packet(place, b"", qos=1, retain=True) for place in (topic, self._state_topic(axis))
        ]

    def _state(self, axis: str) -> Packet:
        content = json.dumps(self._states[axis].members).encode()
        return Packet(self._state_topic(axis), content, qos=1, retain=True)

    def _state_topic(self, axis: str) -> str:
        return f"{self._root}/{axis}/state"

    def _description(self, axis: str) -> Packet:
        name = identifier(self._machine, axis)
        said = discovery(
            name,
            f"{self._machine} {axis}",
            self._state_topic(axis),
            f"{self._root}/online",
            round(self._patience_s),
        )
        topic = f"{self._prefix}/device/{object_id(name)}/config"
        return Packet(topic, json.dumps(said).encode(), qos=1, retain=True)


def _identifiers(payload: bytes) -> list[Any]:
    """Identifiers of a device that somebody has described; none of what is no description."""
    try:
        found = json.loads(payload)["device"]["identifiers"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return []
    return found if isinstance(found, list) else []
