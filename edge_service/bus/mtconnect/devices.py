"""Description of the machine for an agent: `Devices.xml` of MTConnect 2.0."""

from collections.abc import Iterable
from datetime import UTC, datetime
from xml.etree import ElementTree

from .items import CONDITIONS, ITEMS, item_name

NAMESPACE = "urn:mtconnect.org:MTConnectDevices:2.0"
OWN = "urn:edge-service:MTConnectDevices:2.0"


def devices_xml(site: str, machine: str, axes: Iterable[str], now_ns: int) -> str:
    """The file: one device with its axes, each with its data items."""
    now = datetime.fromtimestamp(now_ns / 1e9, UTC)
    root = ElementTree.Element("MTConnectDevices", {"xmlns": NAMESPACE, "xmlns:x": OWN})
    header = {"creationTime": f"{now:%Y-%m-%dT%H:%M:%SZ}", "sender": "edge-service"}
    header |= {"instanceId": "1", "version": "2.0", "deviceModelChangeTime": header["creationTime"]}
    header |= {"assetBufferSize": "1024", "assetCount": "0", "bufferSize": "131072"}
    ElementTree.SubElement(root, "Header", header)
    devices = ElementTree.SubElement(root, "Devices")
    device = ElementTree.SubElement(
        devices, "Device", {"id": "machine", "name": machine, "uuid": f"{site}.{machine}"}
    )
    items = ElementTree.SubElement(device, "DataItems")
    _item(items, "avail", {"category": "EVENT", "type": "AVAILABILITY"})
    components = ElementTree.SubElement(device, "Components")
    group = ElementTree.SubElement(components, "Axes", {"id": "axes", "name": "axes"})
    place = ElementTree.SubElement(group, "Components")
    for axis in axes:
        _axis(place, axis)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _axis(place: ElementTree.Element, axis: str) -> None:
    linear = ElementTree.SubElement(place, "Linear", {"id": f"axis_{axis}", "name": axis})
    items = ElementTree.SubElement(linear, "DataItems")
    screw = {"compositionId": f"screw_{axis}"}
    for name, kind in CONDITIONS.items():
        _item(items, item_name(name, axis), {"category": "CONDITION", "type": kind} | screw)
    for name, item in ITEMS.items():
        facts = {"category": item.category, "type": item.kind, "subType": item.subtype}
        facts |= {"units": item.units} | screw
        _item(items, item_name(name, axis), {key: value for key, value in facts.items() if value})
    compositions = ElementTree.SubElement(linear, "Compositions")
    ElementTree.SubElement(
        compositions, "Composition", {"id": screw["compositionId"], "type": "BALLSCREW"}
    )


def _item(items: ElementTree.Element, name: str, facts: dict[str, str]) -> None:
    ElementTree.SubElement(items, "DataItem", {"id": name, "name": name} | facts)
