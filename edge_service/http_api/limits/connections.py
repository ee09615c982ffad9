"""Connections at once: a bound for all, and one for each address; who idles longest gives way."""

import ipaddress
from collections import Counter, OrderedDict
from http import HTTPStatus
from typing import Protocol


class Connection(Protocol):
    """One client's connection, as far as its place is concerned."""

    address: str

    def give_way(self) -> None:
        """Close: another one needs the place."""


class Connections:
    """Places of the connections.

    Args:
        most: connections at once.
        most_of_one: at once from one address that is not loopback; behind those of loopback may
            be many people, by a proxy or a tunnel.
    """

    def __init__(self, most: int, most_of_one: int) -> None:
        self.most, self._most_of_one = most, most_of_one
        self._held: dict[Connection, None] = {}
        self._idle: OrderedDict[Connection, None] = OrderedDict()
        self._by_address: Counter[str] = Counter()

    def __len__(self) -> int:
        return len(self._held)

    def of(self, address: str) -> int:
        """Connections of one address."""
        return self._by_address[address]

    def admit(self, connection: Connection) -> HTTPStatus | None:
        """Take a place, idle at first; else the status that says why there is none."""
        of_one = self._by_address[connection.address]
        if of_one >= self._most_of_one and not is_loopback(connection.address):
            return HTTPStatus.TOO_MANY_REQUESTS
        if len(self._held) >= self.most and not self._make_way():
            return HTTPStatus.SERVICE_UNAVAILABLE
        self._held[connection] = self._idle[connection] = None
        self._by_address[connection.address] += 1
        return None

    def busy(self, connection: Connection) -> None:
        """Note that a request of it is being answered."""
        self._idle.pop(connection, None)

    def idle(self, connection: Connection) -> None:
        """Note that it waits for a request, from now on."""
        if connection in self._held:
            self._idle[connection] = None
            self._idle.move_to_end(connection)

    def leave(self, connection: Connection) -> None:
        """Free its place; safe twice, and without one."""
        if self._held.pop(connection, connection) is None:
            self._idle.pop(connection, None)
            self._by_address[connection.address] -= 1
            self._by_address += Counter()  # forgets addresses without connections

    def _make_way(self) -> bool:
        if not self._idle:
            return False
        longest = next(iter(self._idle))
        self.leave(longest)
        longest.give_way()
        return True


def is_loopback(address: str) -> bool:
    """Tell whether an address is of this machine; one that is none is not."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False
