"""Contribution of each named effect to the gap: columns, channel, and the steps of a waterfall."""

from collections.abc import Mapping, Sequence

import numpy as np

from ...messages.samples import Floats
from ..candidates.regressor import EntryRegressor
from ..session.session import Session
from .estimates import Estimates


def grouped(
    regressors: Sequence[EntryRegressor], columns: Sequence[Mapping[str, Floats]]
) -> dict[str, dict[str, Floats]]:
    """Columns of each effect by channel, in the order of the regressors."""
    found: dict[str, dict[str, Floats]] = {}
    for regressor, each in zip(regressors, columns, strict=True):
        mine = found.setdefault(regressor.name, {})
        for channel, column in each.items():
            mine[channel] = np.column_stack((mine[channel], column)) if channel in mine else column
    return found


def channel_of(
    session: Session,
    name: str,
    columns: Mapping[str, Floats],
    regressors: Sequence[EntryRegressor],
    values: Estimates,
) -> str:
    """The channel of which an effect makes the greater part."""
    beta = np.concatenate(
        [values.coefficients(k) for k, a in enumerate(regressors) if a.name == name]
    )
    return max(
        session.channels,
        key=lambda channel: (
            float(np.mean((columns[channel] @ beta) ** 2)) / session.channels[channel].rms ** 2
        ),
    )


def waterfall(
    session: Session, parts: Mapping[str, Mapping[str, Floats]]
) -> dict[str, list[tuple[str, float]]]:
    """Root mean square as effects are added, the most helpful first, by channel.

    Args:
        parts: effect -> channel -> what it makes of the gap, (n,).
    """
    return {
        channel: _steps(rows.gap, {name: each[channel] for name, each in parts.items()})
        for channel, rows in session.channels.items()
    }


def _steps(gap: Floats, parts: Mapping[str, Floats]) -> list[tuple[str, float]]:
    left, open_, steps = gap, set(parts), []
    while open_:
        rest = {name: left - parts[name] for name in sorted(open_)}
        name = min(rest, key=lambda n: float(np.sum(rest[n] ** 2)))
        left = rest[name]
        open_.remove(name)
        steps.append((name, float(np.sqrt(np.mean(left**2)))))
    return steps
