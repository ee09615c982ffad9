"""Causes beside a force that nobody can foresee: it hides and feigns them while it acts."""

from collections.abc import Mapping

import numpy as np

from ..candidates.design_matrix import Dictionary
from ..candidates.force_pulses import Push
from ..session.session import Session
from .causes import Candidate, Causes, find_causes
from .evidence import Noise, fit

LEAST_FREE_SHARE = 0.3
"""Share of the motion that must be free of a force for other causes to be sought there alone."""


def beside_force(
    session: Session,
    dictionary: Dictionary,
    noise: Noise,
    limits: Mapping[str, tuple[float, float]],
    causes: Causes,
) -> tuple[Causes, dict[str, float]]:
    """Other causes from the motion that no force disturbs: a force hides and feigns them.

    Returns the causes, and what is left outside the force.
    """
    whole = causes.best.fit
    pushes = [a for a in whole.atoms if isinstance(dictionary.atoms[a], Push)]
    free = {name: np.ones(len(rows.gap), np.bool_) for name, rows in session.channels.items()}
    for push in (dictionary.atoms[a] for a in pushes):
        for name, rows in session.channels.items():
            if isinstance(push, Push):
                free[name] &= ~push.covers(rows.variables["time_s"])
    if min(float(each.mean()) for each in free.values()) < LEAST_FREE_SHARE:
        return causes, dict(whole.rms)
    first = next(k for k, atom in enumerate(dictionary.atoms) if isinstance(atom, Push))
    calm = find_causes(dictionary.restricted(first, session, free), noise, limits)
    beside = calm.best.fit
    tolerated_beta = beside.coefficients[: int(dictionary.first[dictionary.tolerated])]
    chosen = [*beside.atoms[dictionary.tolerated :], *pushes]
    both = Candidate(
        fit(dictionary, chosen, noise, tolerated_beta), calm.best.material | {"external_force"}
    )
    return (
        Causes(
            both,
            {**calm.probability, "external_force": causes.probability["external_force"]},
            {**calm.classes, "external_force": causes.classes["external_force"]},
            calm.candidates,
        ),
        dict(beside.rms),
    )
