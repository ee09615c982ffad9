"""Contributions of the named effects to the gap, by entries of the library fitted together."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ..selection.posterior import Posterior
from ..session.session import Session, rms
from .entries import entries_of
from .estimates import Estimates


@dataclass(frozen=True, slots=True, eq=False)
class Contributions:
    """Entries of the named effects and their parts of the gap.

    Attributes:
        named: effects that were to be fitted; of one without an entry nothing is known.
        by_effect: effect -> channel -> its contribution to the gap, (n,).
        left: what all of them leave of the gap, by channel, (n,).
        channel_of: effect -> the channel of whose gap it makes the greater part.
    """

    session: Session
    named: frozenset[str]
    estimates: Estimates
    by_effect: Mapping[str, Mapping[str, Floats]]
    left: Mapping[str, Floats]
    channel_of: Mapping[str, str]

    @classmethod
    def of_effects(cls, posterior: Posterior, named: frozenset[str]) -> "Contributions":
        """Fit the entries of some effects."""
        problem, session = posterior.problem, posterior.problem.session
        entries = entries_of(problem, posterior.best.fit, named)
        solution = entries.solve()
        estimates = Estimates(problem.priors, entries, solution.beta, solution.square)
        by_effect = {
            name: {channel: estimates.contribution(name, channel) for channel in session.channels}
            for name in estimates.names
        }
        left, energy = {}, {}
        for channel, rows in session.channels.items():
            parts = [each[channel] for each in by_effect.values()]
            left[channel] = rows.gap - sum(parts, np.zeros(len(rows.gap)))
            energy[channel] = rows.rms**2
        channel_of = {
            name: max(session.channels, key=lambda c: float(np.mean(parts[c] ** 2)) / energy[c])
            for name, parts in by_effect.items()
        }
        return cls(session, named, estimates, by_effect, left, channel_of)

    @property
    def left_beside_nuisances(self) -> dict[str, Floats]:
        """Residual when what a healthy axis may have is taken away too, by channel, (n,)."""
        system = self.estimates.fitted.system
        return {name: each - system.fixed[name] @ system.mean for name, each in self.left.items()}

    def waterfall(self) -> dict[str, list[tuple[str, float]]]:
        """Root mean square as effects are added, the most helpful first, by channel."""
        found = {}
        for channel, rows in self.session.channels.items():
            left, open_, steps = rows.gap, set(self.by_effect), []
            while open_:
                rest = {name: left - self.by_effect[name][channel] for name in sorted(open_)}
                name = min(rest, key=lambda n: float(np.sum(rest[n] ** 2)))
                left = rest[name]
                open_.remove(name)
                steps.append((name, rms(left)))
            found[channel] = steps
        return found
