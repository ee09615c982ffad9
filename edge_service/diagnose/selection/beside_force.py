"""Causes beside a force that nobody can foresee: it hides and feigns them while it acts."""

from collections.abc import Mapping

import numpy as np

from ..candidates.design_matrix import DesignMatrix
from ..candidates.force_pulses import FORCE, ForcePulse
from ..session.session import Session
from .evidence import Noise, fit
from .posterior import EffectSet, Posterior, select_effects

LEAST_FREE_SHARE = 0.3
"""Share of the motion that must be free of a force for other causes to be sought there alone."""


def beside_force(
    session: Session,
    design: DesignMatrix,
    noise: Noise,
    priors: Mapping[str, tuple[float, float]],
    causes: Posterior,
) -> tuple[Posterior, dict[str, float]]:
    """Other causes from the motion that no force disturbs: a force hides and feigns them.

    Returns the causes, and what is left outside the force.
    """
    whole = causes.best.fit
    pulses = [a for a in whole.regressors if isinstance(design.regressors[a], ForcePulse)]
    free = {name: np.ones(len(rows.gap), np.bool_) for name, rows in session.channels.items()}
    for pulse in (design.regressors[a] for a in pulses):
        for name, rows in session.channels.items():
            if isinstance(pulse, ForcePulse):
                free[name] &= ~pulse.covers(rows.variables["time_s"])
    if min(float(each.mean()) for each in free.values()) < LEAST_FREE_SHARE:
        return causes, dict(whole.rms)
    first = next(
        k for k, regressor in enumerate(design.regressors) if isinstance(regressor, ForcePulse)
    )
    calm = select_effects(design.restricted(first, session, free), noise, priors)
    beside = calm.best.fit
    nuisance_coefficients = beside.coefficients[: int(design.first[design.tolerated])]
    chosen = [*beside.regressors[design.tolerated :], *pulses]
    both = EffectSet(
        fit(design, chosen, noise, nuisance_coefficients), calm.best.material | {FORCE}
    )
    return (
        Posterior(
            both,
            {**calm.probability, FORCE: causes.probability[FORCE]},
            {**calm.classes, FORCE: causes.classes[FORCE]},
            calm.candidates,
        ),
        dict(beside.rms),
    )
