"""Held-out motion replayed in the simulated plant, without and with the named effects.

Measured less simulated goes through the filter and over the rows of the gap. The values that the
plant has in a block of time come from the other blocks.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...messages.samples import Floats
from ...models.effects.effect import ActiveEffect
from ...models.machine import Machine
from ..result import ReplayedGap, ReplayedSeries, Shrink
from ..session.prescribed_motion import PrescribedMotionAxis
from ..session.session import Session, rms
from .assessment import CrossValidation, on_other_motion


@dataclass(frozen=True, slots=True, eq=False)
class Replay:
    """Replay of a session."""

    gap: Mapping[str, ReplayedGap]  # by channel
    series: Mapping[str, ReplayedSeries]  # by channel
    effects: Mapping[str, Shrink]  # how far each shrinks what the others leave of its channel
    problem: str = ""  # why there is no replay; empty where there is one


def replay(
    machine: Machine,
    validation: CrossValidation,
    channels: Mapping[str, str],
    floors: Mapping[str, float],
    loss: ActiveEffect | None = None,
) -> Replay:
    """Replay a session without effects, with all, and with all but each.

    Args:
        channels: effect -> the channel that it is assessed in.
        floors: channel -> gap that no model could explain.
        loss: of the preload, which was known before; it is one of the `channels`.
    """
    if not channels:
        return Replay({}, {}, {}, "no effect is named")
    whole = validation.values.fitted.system.session
    try:  # both sides beside the bare baseline: what else is modelled is in the plant
        session = whole.beside(Session.of_runs(whole.runs, whole.baseline))
        axis = PrescribedMotionAxis.of_machine(machine, session.baseline)

        def left(names: Sequence[str]) -> dict[str, Floats]:
            known = [loss] if loss is not None and loss.effect.name in names else []
            folds = session.folds
            variants = [axis.with_effects(known + x.active(names)) for x in validation.folds]
            runs = [axis.simulated(r, variants, folds(r.motion.time_s)) for r in session.runs]
            simulated = Session.of_runs(runs, session.baseline)
            return {n: rows.gap - simulated.channels[n].gap for n, rows in session.channels.items()}

        bare, full = left(()), left(tuple(channels))
        effects = {}
        for name, channel in channels.items():
            if channel in session.channels:
                others = tuple(other for other in channels if other != name)
                without = left(others) if others else bare
                rows = replace(session.channels[channel], gap=without[channel])
                effects[name] = on_other_motion(rows, [full[channel]])
    except ValueError as error:
        return Replay({}, {}, {}, str(error))
    gap, series = {}, {}
    for name, rows in session.channels.items():
        after = rms(full[name])
        beyond = math.sqrt(max(after**2 - floors[name] ** 2, 0.0))
        shrink = on_other_motion(replace(rows, gap=bare[name]), [full[name]])
        gap[name] = ReplayedGap(
            before=rms(bare[name]), after=after, unexplained=beyond, shrink=shrink
        )
        series[name] = ReplayedSeries(rows.variables["time_s"], bare[name], full[name])
    return Replay(gap, series, effects)
