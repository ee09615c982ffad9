"""Word to systemd: ready, how it goes, stopping, and a sign of life while every task has one."""

import os
import socket
from collections.abc import Callable, Mapping

FEEDS_PER_PERIOD = 4.0
_LONGEST_STATUS = 200


class Watchdog:
    """Notifier of whoever started the process, in the protocol of sd_notify(3).

    Args:
        send: sends a line; None if nobody listens.
        period_s: time after which the process is taken for dead; None without a watchdog.
    """

    def __init__(self, send: Callable[[str], None] | None, period_s: float | None) -> None:
        self._send = send
        self._feed_s = None if period_s is None else period_s / FEEDS_PER_PERIOD
        self._fed_s = float("-inf")
        self._ready = False
        self._status = ""

    @classmethod
    def of_environment(cls, environment: Mapping[str, str] = os.environ) -> "Watchdog":
        """As the environment says; nothing is sent without NOTIFY_SOCKET."""
        address = environment.get("NOTIFY_SOCKET", "")
        send = _sender(address) if address[:1] in ("/", "@") else None
        mine = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        usec = environment.get("WATCHDOG_USEC", "")
        period_s = int(usec) / 1e6 if mine and usec.isdecimal() and int(usec) > 0 else None
        return cls(send, period_s)

    def look(self, now_s: float, *, ready: bool, well: bool, status: str) -> None:
        """Say what has changed; feed the watchdog while all is well.

        Args:
            ready: the service does its work.
            well: no task is beyond help.
        """
        if ready and not self._ready:
            self._ready = True
            self._tell("READY=1")
        if status != self._status:
            self._status = status
            self._tell(f"STATUS={status[:_LONGEST_STATUS]}")
        if well and self._feed_s is not None and now_s - self._fed_s >= self._feed_s:
            self._fed_s = now_s
            self._tell("WATCHDOG=1")

    def stopping(self) -> None:
        """Say that the end has begun."""
        self._tell("STOPPING=1")

    def _tell(self, line: str) -> None:
        if self._send is not None:
            self._send(line)


def _sender(address: str) -> Callable[[str], None]:
    place = "\0" + address[1:] if address.startswith("@") else address

    def send(line: str) -> None:
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as to:
                to.setblocking(False)
                to.sendto(line.encode(), place)
        except OSError:
            return  # nobody listens any more, or not fast enough: the next word comes soon

    return send
