"""Contributions of the named effects to the gap, by entries of the library fitted together."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ..selection.selected_model import SelectedModel
from ..session.session import Session
from .entries import entries_of
from .estimates import Estimates
from .least_squares import WeightedLeastSquares


@dataclass(frozen=True, slots=True, eq=False)
class Contributions:
    """Entries of the named effects and what they make of the gap.

    Attributes:
        by_effect: effect -> channel -> its contribution to the gap, (n,).
        left: what all of them leave of the gap, by channel, (n,).
        channel_of: effect -> the channel that it affects most.
    """

    estimates: Estimates
    by_effect: Mapping[str, Mapping[str, Floats]]
    left: Mapping[str, Floats]
    channel_of: Mapping[str, str]

    def left_beside_nuisances(self) -> dict[str, Floats]:
        """Residual when what a healthy axis may have is taken away too, by channel, (n,)."""
        fitted = self.estimates.system
        return {name: each - fitted.fixed[name] @ fitted.mean for name, each in self.left.items()}


def contributions_of(selected: SelectedModel, named: frozenset[str]) -> Contributions:
    """Fit the entries of some effects."""
    session, estimates = selected.session, _estimates(selected, named)
    by_effect = {
        name: {channel: estimates.contribution(name, channel) for channel in session.channels}
        for name in estimates.names
    }
    left = {
        name: rows.gap - sum((each[name] for each in by_effect.values()), np.zeros(len(rows.gap)))
        for name, rows in session.channels.items()
    }
    channel_of = {name: _strongest_channel(session, each) for name, each in by_effect.items()}
    return Contributions(estimates, by_effect, left, channel_of)


def _estimates(selected: SelectedModel, named: frozenset[str]) -> Estimates:
    problem, best = selected.problem, selected.posterior.best.fit
    least_squares = WeightedLeastSquares.of_fit(selected.session, problem, best)
    entries = tuple(entries_of(problem, best, named, least_squares))
    columns = tuple(least_squares.columns(each) for each in entries)
    solution = least_squares.solve(entries, columns)
    return Estimates(problem.priors, least_squares, entries, columns, *solution)


def _strongest_channel(session: Session, parts: Mapping[str, Floats]) -> str:
    """Channel of whose gap an effect makes the greater part."""
    return max(
        session.channels,
        key=lambda channel: (
            float(np.mean(parts[channel] ** 2)) / session.channels[channel].rms ** 2
        ),
    )
