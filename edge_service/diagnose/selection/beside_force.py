"""Effects beside a force that no motion predicts: it hides and feigns them while it acts."""

from dataclasses import replace

import numpy as np

from ..candidates.force_pulses import FORCE, ForcePulse
from ..session.session import Session
from .posterior import EffectSet, Posterior, select_effects
from .problem import SelectionProblem

LEAST_FREE_SHARE = 0.3
"""Share of the motion that must be free of a force for other causes to be sought there alone."""


def beside_force(
    session: Session, problem: SelectionProblem, posterior: Posterior
) -> tuple[Posterior, dict[str, float]]:
    """Select other causes from the motion that no force disturbs.

    Returns the posterior, and the root mean square that is left outside the force, by channel.
    """
    whole, regressors = posterior.best.fit, problem.design.regressors
    pulses = [a for a in whole.regressors if isinstance(regressors[a], ForcePulse)]
    free = {name: np.ones(len(rows.gap), np.bool_) for name, rows in session.channels.items()}
    for pulse in (regressors[a] for a in pulses):
        for name, rows in session.channels.items():
            if isinstance(pulse, ForcePulse):
                free[name] &= ~pulse.covers(rows.variables["time_s"])
    if min(float(each.mean()) for each in free.values()) < LEAST_FREE_SHARE:
        return posterior, dict(whole.rms)
    first = next(k for k, each in enumerate(regressors) if isinstance(each, ForcePulse))
    calm = select_effects(replace(problem, design=problem.design.restricted(first, session, free)))
    beside = calm.best.fit
    both = EffectSet(
        problem.pinned_to(beside).fit([*beside.chosen, *pulses]),
        calm.best.material | {FORCE},
    )
    return (
        Posterior(
            both,
            {**calm.probability, FORCE: posterior.probability[FORCE]},
            {**calm.classes, FORCE: posterior.classes[FORCE]},
            calm.candidates,
        ),
        dict(beside.rms),
    )
