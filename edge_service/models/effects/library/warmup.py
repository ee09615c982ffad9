"""Friction that fades while the axis warms up; the sensor on the housing follows late."""

from collections.abc import Iterator

import numpy as np

from ..baseline import Baseline
from ..contribution import (
    Contribution,
    Curve,
    DryFriction,
    Over,
    Side,
    ViscousFriction,
    lagged_warming,
)
from ..effect import Effect, Kind, Values, amount, reference_temperature, shape
from ..empirical import Covered, EmpiricalForm, MotionCurve, heat

WARM_RISE_K = 8.0
"""Assumption: what the housing warms up by while the friction falls; it is no measure of that."""
_LEAST_K = 8.0
_SPANS_K = (_LEAST_K, 16.0, 40.0)
"""Tried: an oil of ISO VG 460 thins to 1/e within 9 K at 0 degC, VG 68 within 20 K at 40 degC
(Walther's law, viscosity index 95); what seems steeper warms up before its sensor does."""
_BY_TIME = ("excess_nm", "viscous_excess_nm_s_per_rad")
_THINNED = ("thinned_nm", "thinned_nm_s_per_rad")


def _contributions(values: Values) -> tuple[Contribution, ...]:
    dry_nm, viscous = values["excess_nm"], values["viscous_excess_nm_s_per_rad"]
    thinned_nm, thinned_viscous = values["thinned_nm"], values["thinned_nm_s_per_rad"]
    fading = _fading(values["time_constant_s"], values["of_cold"])
    thinning = _thinning(values["reference_c"], values["span_k"])
    rise_k = WARM_RISE_K if dry_nm or viscous else 0.0
    parts: list[Contribution] = [lagged_warming(rise_k, values["time_constant_s"])]
    if dry_nm:
        parts.append(DryFriction(Over.TIME, _times(dry_nm, fading), Side.AS_DRAG))
    if viscous:
        parts.append(ViscousFriction(Over.TIME, _times(viscous, fading)))
    if thinned_nm:
        parts.append(DryFriction(Over.TEMPERATURE, _times(thinned_nm, thinning), Side.AS_DRAG))
    if thinned_viscous:
        parts.append(ViscousFriction(Over.TEMPERATURE, _times(thinned_viscous, thinning)))
    return tuple(parts)


def _times(amount: float, curve: Curve) -> Curve:
    return lambda variable: amount * curve(variable)


def _fading(time_constant_s: float, of_cold: float) -> Curve:
    return lambda time_s: np.exp(-time_s / time_constant_s) - of_cold


def _thinning(reference_c: float, span_k: float) -> Curve:
    return lambda temperature_c: np.expm1(-(temperature_c - reference_c) / span_k)


def _empirical_forms(covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    """Friction that fades as the axis' own motion heats it."""
    for tau_s in covered.time_constants_s:
        yield EmpiricalForm("heat", (_fading_by_motion("direction", tau_s),))
        yield EmpiricalForm("heat_viscous", (_fading_by_motion("speed_rad_s", tau_s),))


def _fading_by_motion(of: str, tau_s: float) -> MotionCurve:
    return lambda motion, _: getattr(motion, of) * np.exp(-2.0 * heat(motion, tau_s))


EFFECT = Effect(
    name="warmup",
    description="A cold axis rubs harder at first, and eases while its lubricant warms up.",
    source=(
        "thesis, Figure 5.11: s(v) F exp(-t / tau), less F where the model is of the cold axis; "
        "viscous friction fades alike; a lubricant that is T warmer is thinner by exp(-T / T0) "
        "(Reynolds, 1886), and where a temperature is recorded it tells more than time does"
    ),
    kind=Kind.FRICTION,
    parameters=(
        amount("excess_nm", "N m", "Additional Coulomb level when cold.", -5.0, 5.0, 0.06),
        amount(
            "viscous_excess_nm_s_per_rad",
            "N m s/rad",
            "Additional viscous friction when cold.",
            -0.1,
            0.1,
            0.0,
        ),
        amount(
            "thinned_nm",
            "N m",
            "Dry friction at the reference temperature that a warmer lubricant takes away.",
            -5.0,
            5.0,
            0.0,
        ),
        amount(
            "thinned_nm_s_per_rad",
            "N m s/rad",
            "Viscous friction at the reference temperature that does the same.",
            -0.1,
            0.1,
            0.0,
        ),
        shape("time_constant_s", "s", "Time to fall to 1/e.", 1.0, 1e5, 1200.0, amounts=_BY_TIME),
        shape(
            "of_cold",
            "1",
            "1 where the model has the friction of the cold axis, 0 where of the warm one.",
            0.0,
            1.0,
            0.0,
            amounts=_BY_TIME,
            tried=(0.0, 0.25, 0.5, 0.75, 1.0),
        ),
        reference_temperature(*_THINNED),
        shape(
            "span_k", "K", "Warming that thins oil to 1/e.", _LEAST_K, 1e3, 12.0, _THINNED, _SPANS_K
        ),
    ),
    contributions=_contributions,
    is_thermal=True,
    most_entries=2,
    empirical_forms=_empirical_forms,
)
