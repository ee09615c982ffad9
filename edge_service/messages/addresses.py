"""Which addresses stay on this machine."""

import ipaddress


def is_loopback(host: str) -> bool:
    """Whether `host` is a loopback address, or `localhost`."""
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        return False


def split_endpoint(endpoint: str) -> tuple[str, int]:
    """Host and port of a loopback endpoint `tcp/host:port`; ValueError says what is wrong."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol != "tcp" or not host or not port.isdigit() or int(port) > 65535:
        raise ValueError(f"{endpoint!r} is no endpoint of the form tcp/127.0.0.1:7447")
    if not is_loopback(host):
        raise ValueError(
            f"{endpoint!r}: only loopback addresses are allowed until TLS and roles exist"
        )
    return host, int(port)
