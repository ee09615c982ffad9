"""Effects that a session could show at all."""

import numpy as np

from ..models.effects.registry import effects
from .atoms import Atom, atoms_of
from .free_forms import free_forms
from .session import Session


def not_judged(session: Session) -> list[str]:
    """Effects without a signature in any recorded channel, by name."""
    free = {form.name for form in free_forms(session)}
    return [name for name in effects() if name not in free and not _shows(name, session)]


def _shows(name: str, session: Session) -> bool:
    """Tell whether the first atom of each form, or its last, has a signature."""
    forms: dict[str, Atom] = {}
    for atom in atoms_of(effects()[name], session):
        forms.setdefault(atom.form, atom)
        forms[atom.form + " last"] = atom
    return any(
        bool(np.any(np.abs(atom.columns(session, channel)) > 0.0))
        for atom in forms.values()
        for channel in session.channels
    )
