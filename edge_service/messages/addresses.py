"""Addresses, of which those that leave this machine need TLS."""

import ipaddress
import re
from typing import Literal
from urllib.parse import urlsplit

Security = Literal["readers", "tls", "open"]
"""Rights at the TCP endpoint of the bus: to read, none, to do anything."""


def is_loopback(host: str) -> bool:
    """Tell whether `host` is a loopback address, or `localhost`."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def split_endpoint(endpoint: str) -> tuple[str, int]:
    """Host and port of `tcp/host:port` on loopback, or `tls/host:port`; ValueError if it is none.

    What is not encrypted stays on this machine.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not host or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"{endpoint!r} is not an endpoint of the form tcp/127.0.0.1:7447")
    if protocol == "tcp" and not is_loopback(host):
        raise ValueError(
            f"{endpoint!r}: tcp is for loopback addresses; others need tls and certificates"
        )
    return host, int(port)


_PLANT = re.compile(r"(tcp|tls)/([^\s/?#;]+):(\d{1,5})")


def check_plant_endpoint(endpoint: str, *, has_certificates: bool, allow_plain: bool) -> None:
    """Check an endpoint of a plant's bus, for which TLS needs certificates. Raises ValueError.

    Args:
        allow_plain: whether TCP may leave this machine.
    """
    found = _PLANT.fullmatch(endpoint)
    if found is None or not 0 < int(found[3]) < 65536:
        raise ValueError(f"{endpoint!r} is not an endpoint of the form tls/plant.example:7447")
    if found[1] == "tls" and not has_certificates:
        raise ValueError(
            f"{endpoint!r} needs ca_certificate, and a certificate of our own with its key"
        )
    if found[1] == "tcp" and not (allow_plain or is_loopback(found[2])):
        raise ValueError(
            f"{endpoint!r} leaves this machine unencrypted: it needs tls, or allow_plain"
        )


def is_http_url(address: str) -> bool:
    """Tell whether `address` names a host by HTTP or HTTPS, as text without blanks."""
    try:
        parts = urlsplit(address)
        right = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # the port is no number, or the host is none
        right = False
    return bool(right) and not re.search(r"[\s\x00-\x1f]", address)


def service_address(address: str) -> str:
    """The address of a service without the slash at its end; ValueError says what is wrong."""
    if not is_http_url(address) or set(address) & set("?#"):
        raise ValueError(f"{address!r} is no address of the form http://127.0.0.1:8080/")
    return address.rstrip("/")
