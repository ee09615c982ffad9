"""Sources of samples: recordings, or a device by its address."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

from ...config import ConfigError
from .greetings import find_devices, usual_ports

EXPECTED = "expected a recording, a host, or modbus://, opc.tcp:// or mqtt:// with host and port"
HERE = "127.0.0.1"
_PORTS = {"modbus": 502, "mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class Source:
    """A driver with those of its settings that the address tells.

    Attributes:
        recordings: where the source is no device.
    """

    driver: str
    settings: dict[str, str | int]
    recordings: tuple[Path, ...] = ()


def source_of(given: Sequence[str]) -> Source:
    """The source that a person names; a host alone is asked what it is. Raises ConfigError."""
    recordings = tuple(Path(each).resolve() for each in given if Path(each).is_file())
    if given and len(recordings) == len(given):
        return Source("replay", {"path": str(recordings[0])}, recordings)
    if len(given) != 1:
        raise ConfigError(f"{' '.join(given)}: several sources; {EXPECTED}")
    address = given[0]
    return _of_address(address if "://" in address else _found_at(address))


def devices_here() -> list[str]:
    """Addresses of devices on this computer."""
    return asyncio.run(find_devices(HERE))


def _found_at(text: str) -> str:
    parts = _split(f"//{text}", text)
    found = asyncio.run(find_devices(parts.hostname or "", parts.port))
    if not found:
        tried = "" if parts.port else f" (tried {usual_ports()})"
        raise ConfigError(f"{text}: neither a file, nor does a device answer there{tried}")
    if len(found) > 1:
        raise ConfigError(f"{text}: several answer there, choose one: {', '.join(found)}")
    return found[0]


def _of_address(text: str) -> Source:
    parts = _split(text, text)
    if parts.scheme == "opc.tcp":
        return Source("opcua", {"url": text})
    if parts.scheme not in _PORTS:
        raise ConfigError(f"{text}: {EXPECTED}")
    url, rest = f"{parts.scheme}://{parts.netloc}", parts.path.strip("/")
    if parts.port is None:
        url += f":{_PORTS[parts.scheme]}"
    if parts.scheme == "modbus":
        return Source("modbus", {"url": f"{url}/{rest or 1}"})
    return Source("mqtt", {"url": url, "topic": rest} if rest else {"url": url})


def _split(address: str, given: str) -> SplitResult:
    """Parts of an address. Raises ConfigError where it has no host, or no possible port."""
    try:
        parts = urlsplit(address)
        if parts.hostname and (parts.port is None or parts.port > 0):
            return parts
    except ValueError:
        pass
    raise ConfigError(f"{given}: {EXPECTED}")
