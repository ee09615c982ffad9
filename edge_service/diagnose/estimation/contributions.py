"""The gap as entries of the library explain it: their values, their parts, and what is left."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from ..candidates.design_matrix import Dictionary
from ..candidates.entries import entries_of, problem_of
from ..selection.causes import Causes
from ..selection.evidence import Noise
from ..session.session import Session
from ..validation.cross_validation import Part, by_blocks
from .values import Values
from .waterfall import channel_of, grouped


@dataclass(frozen=True, slots=True, eq=False)
class Weighed:
    """A session whose sets of effects are weighed, but not yet judged.

    Attributes:
        limits: parameter effect -> healthy mean and tolerance of its amount.
        unexplained: share of each channel's energy above the floor that the best set leaves.
    """

    session: Session
    machine: Machine
    dictionary: Dictionary
    noise: Noise
    limits: Mapping[str, tuple[float, float]]
    causes: Causes
    unexplained: Mapping[str, float]

    def floor_source(self, channel: str) -> str:
        """Origin of a channel's floor: `reference` where healthy recordings tell it."""
        healthy = self.session.healthy
        return "reference" if healthy is not None and channel in healthy.floor else "recording"

    def left_by_forms(self) -> dict[str, Floats]:
        """Residual that the best set leaves of the gap with all forms that bear a name, (n,)."""
        best = self.causes.best.fit
        return {
            name: rows.gap - self.dictionary.modelled(name, best.atoms, best.coefficients)
            for name, rows in self.session.channels.items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """Entries of the named effects, fitted together.

    Attributes:
        columns: effect -> channel -> its columns.
        blocks: the entries fitted without each part of the time.
        parts: effect -> channel -> what it makes of the gap, (n,).
        left: what all of them leave of the gap, by channel, (n,).
        channel_of: effect -> the channel that it affects most.
    """

    values: Values
    columns: Mapping[str, Mapping[str, Floats]]
    blocks: tuple[Part, ...]
    parts: Mapping[str, Mapping[str, Floats]]
    left: Mapping[str, Floats]
    channel_of: Mapping[str, str]

    def left_rms(self) -> dict[str, float]:
        """Root mean square of what is left, by channel."""
        return {name: float(np.sqrt(np.mean(each**2))) for name, each in self.left.items()}

    def left_of_tolerated(self) -> dict[str, Floats]:
        """Residual when what is tolerated is taken away too, by channel, (n,)."""
        problem = self.values.problem
        return {name: each - problem.fixed[name] @ problem.mean for name, each in self.left.items()}


def explained(weighed: Weighed, named: frozenset[str]) -> Explained:
    """Fit the entries of some effects."""
    session, values = weighed.session, _values(weighed, named)
    columns = grouped(values.atoms, values.columns)
    parts = {name: _part(session, name, values) for name in columns}
    left = {
        name: rows.gap - sum((each[name] for each in parts.values()), np.zeros(len(rows.gap)))
        for name, rows in session.channels.items()
    }
    channels = {
        name: channel_of(session, name, each, values.atoms, values)
        for name, each in columns.items()
    }
    return Explained(values, columns, by_blocks(values), parts, left, channels)


def _values(weighed: Weighed, named: frozenset[str]) -> Values:
    best, noise = weighed.causes.best.fit, weighed.noise
    problem = problem_of(weighed.session, weighed.dictionary, best, noise)
    atoms = tuple(entries_of(weighed.dictionary, noise, named, problem, best))
    columns = tuple(problem.columns(atom) for atom in atoms)
    return Values(weighed.limits, problem, atoms, columns, *problem.solve(atoms, columns))


def _part(session: Session, name: str, values: Values) -> dict[str, Floats]:
    """Contribution of the entries of an effect to the gap, by channel."""
    mine = [k for k, atom in enumerate(values.atoms) if atom.name == name]
    return {
        channel: sum(
            (values.columns[k][channel] @ values.coefficients(k) for k in mine),
            np.zeros(len(rows.gap)),
        )
        for channel, rows in session.channels.items()
    }
