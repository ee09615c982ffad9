"""What each named effect makes of the gap: its columns, its channel, the steps of a waterfall."""

from collections.abc import Mapping, Sequence

import numpy as np

from ..messages.samples import Floats
from .atoms import EntryAtom
from .session import Session
from .values import Values


def grouped(
    atoms: Sequence[EntryAtom], columns: Sequence[Mapping[str, Floats]]
) -> dict[str, dict[str, Floats]]:
    """Columns of each effect by channel, in the order of the atoms."""
    found: dict[str, dict[str, Floats]] = {}
    for atom, each in zip(atoms, columns, strict=True):
        mine = found.setdefault(atom.name, {})
        for channel, column in each.items():
            mine[channel] = np.column_stack((mine[channel], column)) if channel in mine else column
    return found


def channel_of(
    session: Session,
    name: str,
    columns: Mapping[str, Floats],
    atoms: Sequence[EntryAtom],
    values: Values,
) -> str:
    """The channel of which an effect makes the greater part."""
    beta = np.concatenate([values.coefficients(k) for k, a in enumerate(atoms) if a.name == name])
    return max(
        session.channels,
        key=lambda channel: (
            float(np.mean((columns[channel] @ beta) ** 2)) / session.channels[channel].rms ** 2
        ),
    )


def waterfall(
    session: Session,
    groups: Mapping[str, Mapping[str, Floats]],
    atoms: Sequence[EntryAtom],
    columns: Sequence[Mapping[str, Floats]],
    values: Values,
) -> dict[str, list[tuple[str, float]]]:
    """Root mean square as effects are added, the most helpful first, by channel."""
    parts = {
        name: {
            channel: sum(
                (
                    columns[k][channel] @ values.coefficients(k)
                    for k, atom in enumerate(atoms)
                    if atom.name == name
                ),
                np.zeros(len(session.channels[channel].gap)),
            )
            for channel in session.channels
        }
        for name in groups
    }
    found: dict[str, list[tuple[str, float]]] = {}
    for channel, rows in session.channels.items():
        left, open_, steps = rows.gap, set(parts), []
        while open_:
            rest = left
            name = min(sorted(open_), key=lambda n: float(np.sum((rest - parts[n][channel]) ** 2)))
            left = left - parts[name][channel]
            open_.remove(name)
            steps.append((name, float(np.sqrt(np.mean(left**2)))))
        found[channel] = steps
    return found
