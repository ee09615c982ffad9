"""Reference: the healthy machine as recordings of it show it; what its model lacks is no fault.

Its inertia and friction are those of the recordings, whatever the machine file takes them for, and
a smooth function of the motion takes up what they have beyond that. How far they part from what
the others of them predict, noise and all, is the floor for any further recording.

Within that floor a torque may take another course over the stroke, with the same mean. So friction,
load, course and spread are compared place by place too, with how the healthy recordings scatter.
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
from ...regression import FALSE_ALARMS
from ...regression.run import Run
from ..result import Change, Diagnosis, Misfit, Verdict
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
_LEAST_HEALTHY = 3
"""Recordings of the healthy machine: fewer do not tell how they scatter."""
FEW = f"changes by place are not judged: that takes {_LEAST_HEALTHY} references that move alike"
_PLACES, _PLACE_ROWS, _LEAST_ROWS = 20, 12, 3
"""Places each way at most; rows that one should have, and must have in each recording."""
_SHARED = 0.5
"""Part of the places each way at which all must move alike."""
UNSHOWN = "{:.0%} of the motion has no like in the reference: its torque is not compared"


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Gap of the healthy machine."""

    # channel -> smooth functions that it follows, and their coefficients, (p,)
    followed: Mapping[str, tuple[SmoothFunctions, Floats]]
    # channel -> root mean square by which a further healthy recording may part from it
    floor: Mapping[str, float]
    known: KDTree  # speeds and accelerations whose torque it knows, if it knows any torque
    sessions: Sequence[Session]  # of each recording

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

    def told(self, found: Diagnosis, session: Session) -> Diagnosis:
        """Diagnosis with what changed by place; the session still has the healthy machine's gap."""
        healthy = [each for each in self.sessions if TORQUE_GAP in each.channels]
        if found.misfit is None or TORQUE_GAP not in session.channels or not healthy:
            return found
        changes = changes_by_place(session, healthy)
        if not changes:
            return found.model_copy(update={"remarks": (*found.remarks, FEW)})
        p_value = float(stats.combine_pvalues([each.p_value for each in changes.values()]).pvalue)
        first, then = (
            {name: each[key] for name, each in found.misfit.per_channel.items()}
            for key in ("p_value", "p_value_after")
        )
        first[TORQUE_GAP] = min(first[TORQUE_GAP], p_value)
        misfit = Misfit.of_channels(first, then if found.effects else first)
        is_new = p_value < FALSE_ALARMS and found.verdict is Verdict.NO_GAP
        verdict = Verdict.UNKNOWN if is_new else found.verdict
        update = {"against_healthy": changes, "misfit": misfit, "verdict": verdict}
        return found.model_copy(update=update)


def changes_by_place(session: Session, healthy: Sequence[Session]) -> dict[str, Change]:
    """Changes of a torque against healthy recordings; none where these do not tell.

    A number has Student's distribution; for the course it is the F-test of Shen and Faraway (2004),
    in which what the healthy differ by beyond noise has one shape, and more noise parts by more.
    """
    parts = [each.channels[TORQUE_GAP] for each in (session, *healthy)]
    count, fewest = len(healthy), min(len(each.gap) for each in parts)
    places = int(np.clip(fewest // (2 * _PLACE_ROWS), 2, _PLACES))
    along = np.concatenate([each.variables["table_position_m"] for each in parts[1:]])
    edges = np.quantile(along, np.linspace(0.0, 1.0, places + 1))
    number, mean, square, *motion = np.array([_at_places(x, edges) for x in parts]).swapaxes(0, 1)
    pace = np.array([paces(*each) for each in zip(*motion, strict=True)])
    apart = np.abs(pace[0] - pace[1:].mean(axis=0)).max(axis=1)
    alike = (number.min(axis=0) >= _LEAST_ROWS) & (apart <= _ALIKE)
    forth = np.tile([False, True], places)[alike]
    if count < _LEAST_HEALTHY or min(sum(forth), sum(~forth)) < _SHARED * places:
        return {}
    dry = (s.column(TORQUE_GAP, lambda m: m.torque_nm * m.approach).mean() for s in healthy)
    friction_nm = float(np.mean(list(dry)))
    number, mean, square = number[:, alike], mean[:, alike], square[:, alike]
    mean, energy = mean / friction_nm, number * (square - mean**2) / friction_nm**2
    back, on = (mean[:, each].mean(axis=1) for each in (~forth, forth))
    spread = 0.5 * np.log(energy.sum(axis=1) / (number - 1.0).sum(axis=1))
    levels = {"friction": 0.5 * (on - back), "load": 0.5 * (on + back), "spread": spread}
    found = {}
    for name, (now, *others) in levels.items():
        usual, scatter = np.mean(others), max(np.std(others, ddof=1), 1e-12)
        p_value = stats.ttest_ind_from_stats(now, 0.0, 1, usual, scatter, count).pvalue
        found[name] = Change(change=now - usual, scatter=scatter, p_value=p_value)
    off = mean - np.where(forth, on[:, None], back[:, None])
    off -= off[1:].mean(axis=0)
    variance = energy / (number - 1.0)
    width = variance[1:].mean(axis=0)
    noise, parted = variance / number / width, np.sum(off**2 / width, axis=1)
    more, *others = noise.sum(axis=1)
    own = np.mean(others)
    scatter = max(parted[1:].sum() / (count - 1), own)
    freedom = scatter**2 / ((scatter - own) ** 2 + np.sum(noise[1:].mean(axis=0) ** 2))
    ratio = parted[0] / (scatter * (1.0 + 1.0 / count) + max(more - own, 0.0))
    found["course"] = Change(
        change=rms(off[0]),
        scatter=rms(off[1:]) * (count / (count - 1.0)) ** 0.5,
        p_value=stats.f.sf(ratio, freedom, freedom * (count - 1)),
    )
    return found


def _at_places(rows: Rows, edges: Floats) -> Floats:
    """Number of rows at each place, back and forth, mean, its square's, speed, acceleration."""
    known = rows.variables
    motion = known["motor_speed_rad_s"], known["motor_acceleration_rad_s2"]
    bins = edges, (-1.5, 0.0, 1.5)
    number, *sums = (
        np.histogram2d(known["table_position_m"], known["direction"], bins, weights=x)[0].ravel()
        for x in (np.ones(len(rows.gap)), rows.gap, rows.gap**2, *motion)
    )
    return np.array((number, *(each / np.maximum(number, 1.0) for each in sums)))


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
    inertia_kg_m2 = model.inertia_kg_m2.value + change["inertia"]
    changed = {  # a motion that shows no inertia does not say that there is none
        "inertia_kg_m2": inertia_kg_m2 if inertia_kg_m2 > 0.0 else model.inertia_kg_m2.value,
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
    return Reference(followed, floor, KDTree(pace), sessions)
