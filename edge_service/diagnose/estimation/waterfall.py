"""Waterfall of the gap: the root mean square that is left as one effect after another is added."""

from collections.abc import Mapping

import numpy as np

from ...messages.samples import Floats
from ..session.session import Session, rms


def waterfall(
    session: Session, contributions: Mapping[str, Mapping[str, Floats]]
) -> dict[str, list[tuple[str, float]]]:
    """Root mean square as effects are added, the most helpful first, by channel.

    Args:
        contributions: effect -> channel -> its contribution to the gap, (n,).
    """
    return {
        channel: _steps(rows.gap, {name: each[channel] for name, each in contributions.items()})
        for channel, rows in session.channels.items()
    }


def _steps(gap: Floats, contributions: Mapping[str, Floats]) -> list[tuple[str, float]]:
    left, open_, steps = gap, set(contributions), []
    while open_:
        rest = {name: left - contributions[name] for name in sorted(open_)}
        name = min(rest, key=lambda n: float(np.sum(rest[n] ** 2)))
        left = rest[name]
        open_.remove(name)
        steps.append((name, rms(left)))
    return steps
