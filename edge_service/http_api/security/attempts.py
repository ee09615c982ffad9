"""Limit of sign-ins that failed, per client and in all."""

import ipaddress
from collections import OrderedDict, deque

PER_CLIENT = 5
IN_ALL = 50
WITHIN_S = 60.0
MOST_CLIENTS = 1000
_SITE_BITS = 64
"""Whoever has one address of version 6 has all that begin alike."""


class Attempts:
    """Moments of the sign-ins that failed lately; bounded, whoever asks."""

    def __init__(self) -> None:
        self._in_all: deque[float] = deque(maxlen=IN_ALL)
        self._clients: OrderedDict[str, deque[float]] = OrderedDict()

    def wait_s(self, client: str, now_s: float) -> float:
        """Time that a client must wait before it may try again; 0 if it need not."""
        own = self._clients.get(_site(client), deque[float]())
        return max(_left(own, PER_CLIENT, now_s), _left(self._in_all, IN_ALL, now_s))

    def failed(self, client: str, now_s: float) -> None:
        """Note a sign-in that failed."""
        site = _site(client)
        self._clients.setdefault(site, deque(maxlen=PER_CLIENT)).append(now_s)
        self._clients.move_to_end(site)
        self._in_all.append(now_s)
        if len(self._clients) > MOST_CLIENTS:
            self._clients.popitem(last=False)


def _left(moments: deque[float], most: int, now_s: float) -> float:
    if len(moments) < most:
        return 0.0
    return max(moments[0] + WITHIN_S - now_s, 0.0)


def _site(client: str) -> str:
    try:
        address = ipaddress.ip_address(client.partition("%")[0])
    except ValueError:
        return client
    if address.version == 4:
        return str(address)
    return str(ipaddress.ip_network((address, _SITE_BITS), strict=False))
