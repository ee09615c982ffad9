"""Held-out motion replayed in the simulated plant, without and with the named effects.

Measured less simulated goes through the filter and over the rows of the gap. The values that the
plant has in a block of time come from the other blocks.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...messages.samples import Floats
from ...models.effects.effect import ActiveEffect
from ...models.effects.registry import active_effect
from ...models.machine import Machine
from ..estimation.estimates import Estimates
from ..residual.folds import block_s, fold_of
from ..session.prescribed_motion import PrescribedMotionAxis
from ..session.session import Session, rms
from .cross_validation import Fold
from .shrink import Shrink, resampled

_LONGEST_S = 300.0
"""Of a longer session only its beginning is replayed."""


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedGap:
    """Gap of one channel, measured less simulated, (n,) each.

    Attributes:
        before: without the effects.
        after: with all of them.
        floor: root mean square that no model could explain.
        shrink: from before to after, resampled by blocks.
    """

    time_s: Floats
    before: Floats
    after: Floats
    floor: float
    shrink: Shrink

    @property
    def before_rms(self) -> float:
        """Root mean square without the effects."""
        return rms(self.before)

    @property
    def after_rms(self) -> float:
        """Root mean square with all effects."""
        return rms(self.after)

    @property
    def unexplained_rms(self) -> float:
        """Residual beyond the floor, root mean square."""
        return math.sqrt(max(self.after_rms**2 - self.floor**2, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Replay of a session.

    Attributes:
        gap: by channel.
        effects: how far each effect shrinks what the others leave of its channel.
        problem: why there is no replay; empty where there is one.
    """

    gap: Mapping[str, ReplayedGap]
    effects: Mapping[str, Shrink]
    problem: str = ""


def replay(
    machine: Machine,
    folds: Sequence[Fold],
    channels: Mapping[str, str],
    floors: Mapping[str, float],
    loss: ActiveEffect | None = None,
) -> Replay:
    """Replay a session without effects, with all, and with all but each.

    Args:
        folds: from `folds_of`.
        channels: effect -> the channel that it is assessed in.
        floors: channel -> gap that no model could explain.
        loss: of the preload, which was known before; it is one of the `channels`.
    """
    if not channels:
        return Replay({}, {}, "no effect is named")
    try:
        return _replay(machine, folds, channels, floors, loss)
    except ValueError as error:
        return Replay({}, {}, str(error))


def _replay(
    machine: Machine,
    folds: Sequence[Fold],
    channels: Mapping[str, str],
    floors: Mapping[str, float],
    loss: ActiveEffect | None,
) -> Replay:
    whole = folds[0].values.system.session
    session = _beginning(whole)
    axis = PrescribedMotionAxis.of_machine(machine, session.baseline)
    length_s = block_s(whole)

    def left(names: Sequence[str]) -> dict[str, Floats]:
        variants = [axis.with_effects(_effects(fold.values, names, loss)) for fold in folds]
        runs = [
            axis.simulated(run, variants, fold_of(run.motion.time_s, length_s))
            for run in session.runs
        ]
        simulated = Session.of_runs(runs, session.baseline)
        return {n: rows.gap - simulated.channels[n].gap for n, rows in session.channels.items()}

    bare, full = left(()), left(tuple(channels))
    gap = {}
    for name, rows in session.channels.items():
        shrink = resampled(rows.block, bare[name], full[name])
        time_s = rows.variables["time_s"]
        gap[name] = ReplayedGap(time_s, bare[name], full[name], floors[name], shrink)
    effects = {}
    for name, channel in channels.items():
        if channel in gap:
            others = tuple(other for other in channels if other != name)
            without = left(others) if others else bare
            block = session.channels[channel].block
            effects[name] = resampled(block, without[channel], full[channel])
    return Replay(gap, effects)


def _effects(
    values: Estimates, names: Sequence[str], loss: ActiveEffect | None
) -> list[ActiveEffect]:
    known = [loss] if loss is not None and loss.effect.name in names else []
    return known + [active_effect(name, each) for name in names for each in values.entries(name)]


def _beginning(session: Session) -> Session:
    """Runs up to about `_LONGEST_S`, one at least, beside the bare baseline.

    Raises:
        ValueError: nothing moves in them.
    """
    ends_s = np.cumsum([run.duration_s for run in session.runs])
    count = max(int(np.searchsorted(ends_s, _LONGEST_S, side="right")), 1)
    runs = session.runs[:count]
    if not any(run.compared_rows.any() for run in runs):
        raise ValueError(f"the axis rests for the first {_LONGEST_S:g} s")
    beginning = Session.of_runs(runs, session.baseline)
    return beginning if session.healthy is None else session.healthy.beside(beginning)
