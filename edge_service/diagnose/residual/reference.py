"""Reference: the healthy machine as recordings of it show it; what its model lacks is no fault.

Its inertia and friction are those of the recordings, whatever the machine file takes them for, and
a smooth function of the motion takes up what they have beyond that. How far they part from what
the others of them predict, noise and all, is the floor for any further recording.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from ...checks.same_axis import by_recording
from ...messages.samples import Floats, Integers
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.effect import ActiveEffect
from ...models.effects.learned import model_effects
from ...models.machine import Machine, Quantity
from ...regression.run import Run
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Rows, Session
from .structure import SmoothFunctions

_RIDGES = (1e-3, 1e-2, 0.1, 1.0)
"""Of the number of rows."""
_LOOSE = 1e-4
"""Ridge of the parameters, of the number of rows: what the motion does not show stays as it was."""
_PARAMETERS: Mapping[str, Callable[[Motion], Floats]] = {
    "inertia": lambda motion: motion.acceleration_rad_s2,
    "viscous": lambda motion: motion.speed_rad_s,
    "dry": lambda motion: motion.direction,
    "constant": lambda motion: np.ones(len(motion)),
}
_LEAST_FREEDOM = 4
"""Degrees of freedom below which Student's distribution says nothing any more."""
_LEVEL = 0.95


@dataclass(frozen=True, slots=True, eq=False)
class _Followed:
    """One channel: forms, and their coefficients (p,)."""

    forms: SmoothFunctions
    beta: Floats

    def at(self, variables: Mapping[str, Floats]) -> Floats:
        found: Floats = self.forms.columns(variables) @ self.beta
        return found


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Gap of the healthy machine.

    Attributes:
        followed: channel -> what it follows.
        floor: channel -> root mean square by which a further healthy recording may part from it.
    """

    followed: Mapping[str, _Followed]
    floor: Mapping[str, float]

    def gap(self, channel: str, rows: Rows) -> Floats:
        """Gap of the healthy machine at the rows of a session, (n,); 0 in a channel not known."""
        if channel not in self.followed:
            return np.zeros(len(rows.gap))
        found = self.followed[channel].at(rows.variables)
        return found - found.mean() if channel == TRANSMISSION_GAP else found

    def beside(self, session: Session) -> Session:
        """Session with what it has beyond the healthy machine as its gap."""
        channels = {
            name: replace(rows, gap=rows.gap - self.gap(name, rows))
            for name, rows in session.channels.items()
        }
        return replace(session, channels=channels, beside=self.beside, healthy_floor=self.floor)


def healthy_model(machine: Machine, runs: Sequence[Run], baseline: Baseline) -> Machine:
    """Machine with inertia, viscous friction and Coulomb level as its recordings show them.

    Args:
        runs: of the healthy machine, beside the `baseline` of `machine`.
    """
    if not any(run.has_torque and run.compared_rows.any() for run in runs):
        return machine
    session = Session.of_runs(runs, baseline, model_effects(machine))
    columns = np.column_stack([session.column(TORQUE_GAP, curve) for curve in _PARAMETERS.values()])
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    gram = (columns / scale).T @ (columns / scale) + _LOOSE * len(columns) * np.eye(len(scale))
    found = np.linalg.solve(gram, (columns / scale).T @ session.channels[TORQUE_GAP].gap) / scale
    change = dict(zip(_PARAMETERS, found.tolist(), strict=True))
    model = machine.model
    dry = "preload_drag_nm" if model.preload_n is None else "bearing_drag_nm"
    level = getattr(model, dry)
    changed = {
        "inertia_kg_m2": max(model.inertia_kg_m2.value + change["inertia"], 1e-12),
        "viscous_nm_s_per_rad": max(model.viscous_nm_s_per_rad.value + change["viscous"], 0.0),
        dry: max((0.0 if level is None else level.value) + change["dry"], 0.0),
    }
    quantities = {name: Quantity(value=value) for name, value in changed.items()}
    return machine.model_copy(update={"model": model.model_copy(update=quantities)})


def healthy_machine(
    runs: Sequence[Run], baseline: Baseline, modelled: Sequence[ActiveEffect] = ()
) -> Reference:
    """Learn the healthy machine from runs of one or more recordings of it."""
    sessions = [
        Session.of_runs(each, baseline, modelled) for _, each in sorted(by_recording(runs).items())
    ]
    followed, floor = {}, {}
    for channel in sorted({name for each in sessions for name in each.channels}):
        mine = [each for each in sessions if channel in each.channels]
        parts = [each.channels[channel] for each in mine]
        group = np.concatenate([np.full(len(rows.gap), k) for k, rows in enumerate(parts)])
        if len(parts) == 1:
            group = mine[0].fold[channel]
        names = set.intersection(*(set(rows.variables) for rows in parts))
        variables = {name: np.concatenate([r.variables[name] for r in parts]) for name in names}
        gap, block = (
            np.concatenate([getattr(rows, name) for rows in parts]) for name in ("gap", "block")
        )
        rows = Rows(gap, variables, block)
        followed[channel], floor[channel] = _learned(rows, channel, group, runs)
    return Reference(followed, floor)


def _learned(
    rows: Rows, channel: str, group: Integers, runs: Sequence[Run]
) -> tuple[_Followed, float]:
    """Learn a gap with the ridge that predicts each group best from the others, and its error."""
    best = math.inf, _RIDGES[-1]
    for ridge in _RIDGES:
        squares = []
        for number in np.unique(group).tolist():
            mine = group == number
            if mine.all():
                continue
            learned = _followed(rows.at(~mine), channel, ridge, runs)
            left = rows.gap[mine] - learned.at(rows.at(mine).variables)
            squares.append(float(np.mean(left**2)))
        if squares and np.mean(squares) < best[0]:
            best = float(np.mean(squares)), ridge
    if not math.isfinite(best[0]):
        best = rows.rms**2, _RIDGES[-1]
    freedom = max(len(np.unique(group)) - 1, _LEAST_FREEDOM)
    wider = float(stats.t.ppf(_LEVEL, freedom) / stats.norm.ppf(_LEVEL))
    return _followed(rows, channel, best[1], runs), wider * math.sqrt(best[0])


def _followed(rows: Rows, channel: str, ridge: float, runs: Sequence[Run]) -> _Followed:
    forms, columns = SmoothFunctions.fitted(
        rows.variables, rows.gap, channel, runs[0].low_pass, timed=False
    )
    gram = columns.T @ columns + ridge * len(columns) * np.eye(columns.shape[1])
    return _Followed(forms, np.linalg.solve(gram, columns.T @ rows.gap).astype(np.float64))
