"""Connections whose TLS handshake is not done: uvicorn sees them only afterwards."""

import socket
from typing import Any

from .connections import Connections, is_loopback
from .settings import HttpLimits


class HandshakeListener(socket.socket):
    """A listening socket that bounds the handshakes under way, of all and of one address.

    What is beyond the bounds is closed without a word: there is no way to say one yet.
    """

    def __init__(self, listener: socket.socket, limits: HttpLimits, places: Connections) -> None:
        """Take over a listening socket; who has a place is through with the handshake."""
        kind = (listener.family, listener.type, listener.proto)
        super().__init__(*kind, fileno=listener.detach())
        self.setblocking(False)
        self._limits, self._places = limits, places
        self._accepted: dict[socket.socket, str] = {}

    def accept(self) -> tuple[socket.socket, Any]:
        """Take a connection; BlockingIOError if its handshake would be one too many."""
        connection, peer = super().accept()
        self._accepted = {each: who for each, who in self._accepted.items() if each.fileno() != -1}
        if self._is_too_much(str(peer[0])):
            connection.close()
            raise BlockingIOError
        self._accepted[connection] = str(peer[0])
        return connection, peer

    def _is_too_much(self, address: str) -> bool:
        if len(self._accepted) - len(self._places) >= self._limits.handshakes:
            return True
        of_one = sum(each == address for each in self._accepted.values())
        shaking = of_one - self._places.of(address)
        return shaking >= self._limits.handshakes_of_one and not is_loopback(address)
