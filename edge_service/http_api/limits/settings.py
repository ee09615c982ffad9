"""Bounds of the HTTP interface, all in one place."""

from dataclasses import dataclass

KB, MB = 1000, 1_000_000


@dataclass(frozen=True, slots=True)
class HttpLimits:
    """Limits of what one client, and all of them together, may take of the service.

    Attributes:
        connections: at once; beyond it the one that has been idle longest goes.
        connections_of_one: at once from one address; a loopback address may have all.
        handshakes, handshakes_of_one: of TLS under way at once, of all and of one address that is
            not loopback; each may take `head_s`.
        backlog: connections that are taken in one go, each with a descriptor of its own.
        reserve: descriptors kept for files, jobs and the bus.
        head_bytes: of a request's line and headers.
        json_bytes: of a body that is no recording.
        upload_bytes: of a recording.
        head_s: within which line and headers must be there.
        body_idle_s: longest pause within a body.
        body_s, body_bytes_per_s: waited for a body at most `body_s`, and a second more for each
            `body_bytes_per_s` that have come.
        linger_s: for which the rest of a refused body is thrown away, so that the answer arrives.
        stall_s: after which a reader that reads too little is cut off.
        send_buffer_bytes: of one connection in the kernel; what a silent reader can hold there.
    """

    connections: int = 256
    connections_of_one: int = 64
    handshakes: int = 64
    handshakes_of_one: int = 8
    backlog: int = 32
    reserve: int = 64
    head_bytes: int = 16 * KB
    json_bytes: int = 64 * KB
    upload_bytes: int = 300 * MB
    head_s: float = 10.0
    body_idle_s: float = 10.0
    body_s: float = 20.0
    body_bytes_per_s: float = 10.0 * KB
    linger_s: float = 1.0
    stall_s: float = 20.0
    send_buffer_bytes: int = 32 * KB
