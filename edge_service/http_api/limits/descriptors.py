"""File descriptors: as many as the system grants, and some of them never given to clients."""

import resource
from pathlib import Path

MOST = 65_536
FEWEST_CONNECTIONS = 4
_OPEN = Path("/proc/self/fd")


def raise_limit() -> int:
    """Raise the soft limit of descriptors to the hard one; the limit that holds then."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MOST if hard == resource.RLIM_INFINITY else min(hard, MOST)
    if soft != resource.RLIM_INFINITY and soft < wanted:
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
        return wanted
    return MOST if soft == resource.RLIM_INFINITY else soft


def affordable_connections(limit: int, wanted: int, reserve: int, opened: int) -> int:
    """Connections for which there are descriptors, beside those open now and the reserve.

    Where the system grants too few for that, half of what is left is for clients.
    """
    left = limit - opened
    return min(wanted, max(left - reserve, left // 2, FEWEST_CONNECTIONS))


def open_descriptors() -> int:
    """Descriptors that this process has open."""
    return sum(1 for _ in _OPEN.iterdir())
