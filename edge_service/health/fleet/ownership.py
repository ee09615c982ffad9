"""Share of each fleet node in a plant: rendezvous hashing (Thaler and Ravishankar, 1998). Pure."""

from collections.abc import Collection
from hashlib import blake2b

from ...messages.plant import BUCKETS


def owner_of(bucket: int, nodes: Collection[str]) -> str | None:
    """Name of the node that reads a part of the plant; None without nodes.

    Everybody who knows the same nodes names the same one. A node that goes leaves only its own
    parts to others, and one that comes takes only those that are its own from now on.
    """
    return max(nodes, key=lambda node: (_weight(bucket, node), node), default=None)


def owned_by(name: str, nodes: Collection[str]) -> frozenset[int]:
    """Parts of the plant that a node reads, of those that are there."""
    return frozenset(each for each in range(BUCKETS) if owner_of(each, nodes) == name)


def _weight(bucket: int, node: str) -> bytes:
    return blake2b(f"{bucket}/{node}".encode(), digest_size=8).digest()
