"""Reference: the healthy machine as recordings of it show it; what its model lacks is no fault.

Its inertia and friction are those of the recordings, whatever the machine file takes them for, and
a smooth function of the motion takes up what they have beyond that. How far they part from what
the others of them predict, noise and all, is the floor for any further recording.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from scipy.spatial import KDTree

from ...checks.same_axis import by_recording
from ...messages.samples import Floats
from ...models.effects.baseline import Baseline, Motion
from ...models.effects.effect import ActiveEffect
from ...models.effects.learned import model_effects
from ...models.machine import Machine, Quantity
from ...regression.run import Run
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Rows, Session, rms
from .noise import SmoothFunctions, paces, predicted_groups, ridge_fits

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
_LEAST_ALIKE, _ALIKE = 24, 3.0
"""So many rows of the references within so many repeats' width tell what the motion takes."""
UNSHOWN = "{:.0%} of the motion has no like in the reference: its torque is not compared"


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Gap of the healthy machine.

    Attributes:
        followed: channel -> smooth functions that it follows, and their coefficients, (p,).
        floor: channel -> root mean square by which a further healthy recording may part from it.
        known: speeds and accelerations whose torque it knows, if it knows any torque.
    """

    followed: Mapping[str, tuple[SmoothFunctions, Floats]]
    floor: Mapping[str, float]
    known: KDTree

    def gap(self, channel: str, rows: Rows) -> Floats:
        """Gap of the healthy machine at the rows of a session, (n,); 0 in a channel not known."""
        if channel not in self.followed:
            return np.zeros(len(rows.gap))
        forms, beta = self.followed[channel]
        found: Floats = forms.columns(rows.variables) @ beta
        return found - found.mean() if channel == TRANSMISSION_GAP else found

    def shown(self, runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
        """Runs whose torque is compared only in motion that the references have, and a remark."""
        found = []
        for run in runs:
            pace = paces(run.motion.speed_rad_s, run.motion.acceleration_rad_s2)
            near, _ = self.known.query(pace, [_LEAST_ALIKE], distance_upper_bound=_ALIKE)
            is_like = np.isfinite(near[:, 0]) | (TORQUE_GAP not in self.followed)
            found.append(replace(run, resolved=run.resolved & is_like))
        kept, asked = (sum(int(x.compared_rows.sum()) for x in part) for part in (found, runs))
        return found, [UNSHOWN.format(1.0 - kept / asked)] if kept < asked else []

    def beside(self, session: Session) -> Session:
        """Session with what it has beyond the healthy machine as its gap."""
        channels = {
            name: replace(rows, gap=rows.gap - self.gap(name, rows))
            for name, rows in session.channels.items()
        }
        return replace(session, channels=channels, beside=self.beside, healthy_floor=self.floor)


def healthy_model(machine: Machine, runs: Sequence[Run], baseline: Baseline) -> Machine:
    """Machine with inertia, viscous friction and Coulomb level as its recordings show them.

    `runs` are of the healthy machine, beside the `baseline` of `machine`.
    """
    if not any(run.has_torque and run.compared_rows.any() for run in runs):
        return machine
    session = Session.of_runs(runs, baseline, model_effects(machine))
    columns = np.column_stack([session.column(TORQUE_GAP, curve) for curve in _PARAMETERS.values()])
    scale = np.sqrt(np.mean(columns**2, axis=0)) + 1e-300
    found = ridge_fits(columns / scale, session.channels[TORQUE_GAP].gap, [_LOOSE])[0] / scale
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
    followed, floor, pace = {}, {}, np.empty((0, 2))
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
        ridge, found = predicted_groups(rows, group, channel, runs[0].low_pass, timed=False)
        forms, columns = SmoothFunctions.fitted(rows, channel, runs[0].low_pass, timed=False)
        followed[channel] = forms, ridge_fits(columns, gap, [ridge])[0]
        freedom = max(len(np.unique(group)) - 1, _LEAST_FREEDOM)
        wider = float(stats.t.ppf(_LEVEL, freedom) / stats.norm.ppf(_LEVEL))
        floor[channel] = wider * rms(gap - found)
        if channel == TORQUE_GAP:
            pace = paces(variables["motor_speed_rad_s"], variables["motor_acceleration_rad_s2"])
    return Reference(followed, floor, KDTree(pace))
