"""Agent of MTConnect that nobody here had a hand in but for the specification of SHDR.

It knows what the agent's protocol and the data model say, no word of the service: types of data
items from `Devices.xml`, everything else from lines (https://mtcup.org/Protocol).
"""

import asyncio
import re
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from xml.etree import ElementTree

STANDARD = {
    "CONDITION": {"ACTUATOR", "COMMUNICATIONS", "DATA_RANGE", "HARDWARE", "SYSTEM"},
    "EVENT": {"AVAILABILITY", "MESSAGE"},
    "SAMPLE": {"LINEAR_FORCE", "LOAD", "TORQUE"},
}
"""Types of the standard that may be met here; any other needs a prefix."""
UNITS = {"LINEAR_FORCE": "NEWTON", "LOAD": "PERCENT", "TORQUE": "NEWTON_METER"}
LEVELS = ("UNAVAILABLE", "NORMAL", "WARNING", "FAULT")


class ProtocolError(Exception):
    """A line that the specification does not allow."""


def tokens(line: str) -> Iterator[str]:
    """Fields of a line: quoted ones may hold escaped signs."""
    place = 0
    while place <= len(line):
        if line[place : place + 1] == '"':
            text, place = "", place + 1
            while line[place : place + 1] != '"':
                if place >= len(line):
                    raise ProtocolError(f"no end of a quotation: {line!r}")
                place += line[place] == "\\"
                text += line[place]
                place += 1
            place += 1
            if line[place : place + 1] not in ("", "|"):
                raise ProtocolError(f"something behind a quotation: {line!r}")
            yield text
        else:
            end = line.find("|", place)
            end = len(line) if end < 0 else end
            yield line[place:end].strip()
            place = end
        place += 1


def item_types(devices_xml: str) -> dict[str, tuple[str, str]]:
    """Category and type of each data item by its name; names and ids are unique."""
    root = ElementTree.fromstring(devices_xml)
    assert root.tag.startswith("{urn:mtconnect.org:MTConnectDevices:")
    space = root.tag.partition("}")[0] + "}"
    ids = [each.attrib["id"] for each in root.iter() if "id" in each.attrib]
    if len(ids) != len(set(ids)):
        raise ProtocolError("an id stands twice")
    known = {}
    for each in root.iter(f"{space}DataItem"):
        category, kind = each.attrib["category"], each.attrib["type"]
        if kind not in STANDARD[category] and not re.fullmatch("x:[A-Z_0-9]+", kind):
            raise ProtocolError(f"{kind} is no type")
        if each.attrib.get("units") != UNITS.get(kind, each.attrib.get("units")):
            raise ProtocolError(f"{kind} has other units")
        known[each.attrib["name"]] = category, kind
    return known


@dataclass
class Agent:
    """State of an agent: what it would answer to `current`."""

    types: dict[str, tuple[str, str]]
    # numbers, events and messages by data item
    values: dict[str, object] = field(default_factory=dict)
    # active levels with their text by data item and native code
    conditions: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)
    # of the last line about each data item
    times: dict[str, datetime] = field(default_factory=dict)
    commands: list[str] = field(default_factory=list)
    seconds: float = 0.0  # agreed heartbeat; 0 without

    def take(self, line: str) -> None:
        if line.startswith("* PONG "):
            self.seconds = int(line.removeprefix("* PONG ")) / 1000.0
        elif line.startswith("* "):
            self.commands.append(line)
        else:
            moment, *fields = tokens(line)
            self._take(datetime.strptime(moment, "%Y-%m-%dT%H:%M:%S.%fZ"), fields)

    def level(self, item: str) -> str:
        return max((level for level, _ in self.conditions[item].values()), key=LEVELS.index)

    def _take(self, moment: datetime, fields: list[str]) -> None:
        category, kind = self._type(fields[0])
        self.times[fields[0]] = moment.replace(tzinfo=UTC)
        if category == "CONDITION":
            self._condition(*fields)
        elif kind == "MESSAGE":
            name, code, text = fields
            self.values[name] = code, text
        else:
            for name, value in zip(fields[::2], fields[1::2], strict=True):
                self._value(name, value)
                self.times[name] = moment.replace(tzinfo=UTC)

    def _value(self, name: str, value: str) -> None:
        category, kind = self._type(name)
        if category == "CONDITION" or kind == "MESSAGE":
            raise ProtocolError(f"{name} needs a line of its own")
        number = category == "SAMPLE" and value != "UNAVAILABLE"
        self.values[name] = float(value) if number else value

    def _condition(
        self, name: str, level: str, code: str, severity: str, qualifier: str, text: str
    ):
        if level not in LEVELS or qualifier not in ("", "LOW", "HIGH"):
            raise ProtocolError(f"{name}: {level} {qualifier}")
        active = self.conditions.setdefault(name, {})
        if level in ("NORMAL", "UNAVAILABLE"):
            if code and level == "NORMAL":
                active.pop(code, None)
            else:
                active.clear()
            if not active:
                active[""] = level, text
        else:
            active.pop("", None)
            active[code] = level, text

    def _type(self, name: str) -> tuple[str, str]:
        if name not in self.types:
            raise ProtocolError(f"{name} is no data item")
        return self.types[name]


@asynccontextmanager
async def connected(port: int, devices_xml: str) -> AsyncIterator[Agent]:
    """An agent that reads and asks for signs of life for as long as the context lasts."""
    agent = Agent(item_types(devices_xml))
    reader, writer = await asyncio.open_connection("127.0.0.1", port)

    async def read() -> None:
        while line := await reader.readline():
            agent.take(line.decode().removesuffix("\n"))

    task = asyncio.create_task(read())
    writer.write(b"* PING\n")
    try:
        yield agent
        if task.done():
            task.result()
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        writer.close()
