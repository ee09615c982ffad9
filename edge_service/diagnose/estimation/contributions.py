"""The gap as entries of the library explain it: their values, their parts, and what is left."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.machine import Machine
from ..candidates.design_matrix import DesignMatrix
from ..candidates.entries import entries_of, problem_of
from ..selection.evidence import Noise
from ..selection.posterior import Posterior
from ..session.session import Session
from ..validation.cross_validation import Fold, folds_of
from .estimates import Estimates
from .waterfall import channel_of, grouped


@dataclass(frozen=True, slots=True, eq=False)
class SelectedModel:
    """A session whose sets of effects are weighed, but not yet judged.

    Attributes:
        priors: parameter effect -> healthy mean and tolerance of its amount.
        unexplained: share of each channel's energy above the floor that the best set leaves.
    """

    session: Session
    machine: Machine
    design: DesignMatrix
    noise: Noise
    priors: Mapping[str, tuple[float, float]]
    posterior: Posterior
    unexplained: Mapping[str, float]

    def floor_source(self, channel: str) -> str:
        """Origin of a channel's floor: `reference` where healthy recordings tell it."""
        healthy = self.session.healthy
        return "reference" if healthy is not None and channel in healthy.floor else "recording"

    def left_by_shapes(self) -> dict[str, Floats]:
        """Residual that the best set leaves of the gap with all forms that bear a name, (n,)."""
        best = self.posterior.best.fit
        return {
            name: rows.gap - self.design.modelled(name, best.regressors, best.coefficients)
            for name, rows in self.session.channels.items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class Contributions:
    """Entries of the named effects, fitted together.

    Attributes:
        columns: effect -> channel -> its columns.
        folds: the entries fitted without each part of the time.
        parts: effect -> channel -> what it makes of the gap, (n,).
        left: what all of them leave of the gap, by channel, (n,).
        channel_of: effect -> the channel that it affects most.
    """

    values: Estimates
    columns: Mapping[str, Mapping[str, Floats]]
    folds: tuple[Fold, ...]
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


def contributions_of(selected: SelectedModel, named: frozenset[str]) -> Contributions:
    """Fit the entries of some effects."""
    session, values = selected.session, _values(selected, named)
    columns = grouped(values.regressors, values.columns)
    parts = {name: _part(session, name, values) for name in columns}
    left = {
        name: rows.gap - sum((each[name] for each in parts.values()), np.zeros(len(rows.gap)))
        for name, rows in session.channels.items()
    }
    channels = {
        name: channel_of(session, name, each, values.regressors, values)
        for name, each in columns.items()
    }
    return Contributions(values, columns, folds_of(values), parts, left, channels)


def _values(selected: SelectedModel, named: frozenset[str]) -> Estimates:
    best, noise = selected.posterior.best.fit, selected.noise
    problem = problem_of(selected.session, selected.design, best, noise)
    regressors = tuple(entries_of(selected.design, noise, named, problem, best))
    columns = tuple(problem.columns(regressor) for regressor in regressors)
    return Estimates(
        selected.priors, problem, regressors, columns, *problem.solve(regressors, columns)
    )


def _part(session: Session, name: str, values: Estimates) -> dict[str, Floats]:
    """Contribution of the entries of an effect to the gap, by channel."""
    mine = [k for k, regressor in enumerate(values.regressors) if regressor.name == name]
    return {
        channel: sum(
            (values.columns[k][channel] @ values.coefficients(k) for k in mine),
            np.zeros(len(rows.gap)),
        )
        for channel, rows in session.channels.items()
    }
