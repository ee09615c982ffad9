"""Observability: effects that a session could show at all, and why it cannot show the others."""

import numpy as np

from ...models.effects.effect import Effect, Kind
from ...models.effects.registry import effects, get_effect
from ..candidates.empirical_shapes import empirical_shapes
from ..candidates.regressor import CandidateRegressor, regressors_of
from ..session.run import is_below
from ..session.session import TORQUE_GAP, TRANSMISSION_GAP, Session

_BETWEEN = {Kind.LOST_MOTION, Kind.TRAVEL, Kind.MEASUREMENT}
"""Kinds of effects that two encoders show; the torque shows the others."""


def is_too_slow(name: str, session: Session) -> bool:
    """Tell whether the sampling is too slow to see an effect."""
    least_hz = get_effect(name).least_rate_hz
    return any(is_below(run.low_pass.period_s, least_hz) for run in session.runs)


def unobservable(session: Session) -> dict[str, str]:
    """Effects that the recording could not show, by name, and why."""
    free = {form.name for form in empirical_shapes(session)}
    rate_hz = 1.0 / max(run.low_pass.period_s for run in session.runs)
    found = {}
    for name, effect in effects().items():
        if effect.is_fault:
            continue
        if is_too_slow(name, session):
            found[name] = (
                f"sampled too slowly: at {rate_hz:.3g} Hz, expected {effect.least_rate_hz:g} Hz"
            )
        elif name not in free and not _shows(name, session):
            found[name] = _lacking(effect, session)
    return found


def _lacking(effect: Effect, session: Session) -> str:
    """Reason why an effect has no signature at all."""
    between = effect.kind in _BETWEEN
    if between and TRANSMISSION_GAP not in session.channels:
        return "one encoder only: what happens between motor and table cannot be seen"
    if not between and TORQUE_GAP not in session.channels:
        return "no torque recorded"
    return "not visible in this motion"


def _shows(name: str, session: Session) -> bool:
    """Tell whether the first regressor of each form, or its last, has a signature."""
    forms: dict[str, CandidateRegressor] = {}
    for regressor in regressors_of(effects()[name], session):
        forms.setdefault(regressor.form, regressor)
        forms[regressor.form + " last"] = regressor
    return any(
        bool(np.any(np.abs(regressor.columns(session, channel)) > 0.0))
        for regressor in forms.values()
        for channel in session.channels
    )
