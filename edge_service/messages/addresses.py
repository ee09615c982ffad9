"""Addresses, of which those that leave this machine need TLS."""

import ipaddress
import re
from urllib.parse import urlsplit


def is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def split_endpoint(endpoint: str) -> tuple[str, int]:
    """Host and port of `tcp/host:port` on loopback; ValueError if it is none.

    What is not encrypted stays on this machine.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp" or not host or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"{endpoint!r} is not an endpoint of the form tcp/127.0.0.1:7447")
    if not is_loopback(host):
        raise ValueError(
            f"{endpoint!r}: tcp is for loopback addresses; state others in bus.zenoh_file"
        )
    return host, int(port)


def is_http_url(address: str) -> bool:
    """Return whether `address` names a host by HTTP or HTTPS, as text without blanks."""
    try:
        parts = urlsplit(address)
        right = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # the port is no number, or the host is none
        right = False
    return bool(right) and not re.search(r"[\s\x00-\x1f]", address)
