"""More give between motor and table than the model knows."""

from collections.abc import Iterator

import numpy as np

from ....messages.samples import Floats
from ..baseline import Baseline, Motion
from ..contribution import Change, Constant, Contribution, PreslidingWindUp
from ..effect import Effect, Kind, Trace, Values, amount, friction_share, shape, viscous_share
from ..empirical import TABLE_SHARES, Covered, EmpiricalForm, MotionCurve, delayed_friction

_COULOMB_SHARES = (0.0, 1.0, 2.0, 2.8, 3.6, 4.8, 6.5)
"""Share of the Coulomb friction behind a spring over the share of the inertia behind it."""
_VISCOUS_SHARES = (0.5, 1.0)
"""Share of the viscous friction behind a spring over that of the Coulomb friction."""
_REACH = (
    "Travel of the motor over which the table's dry friction builds up on a recording; "
    "0: at once. A simulated axis has that of its spring."
)


def _contributions(values: Values) -> tuple[Contribution, ...]:
    level, slope = values["level_m_per_n"], values["slope_per_n"]
    coulomb, viscous = values["friction_share"] - 1.0, values["viscous_share"]
    changes = (
        (Constant.COMPLIANCE, level),
        (Constant.COMPLIANCE_SLOPE, slope),
        (Constant.COULOMB_LOAD_COMPLIANCE, coulomb * level),
        (Constant.COULOMB_LOAD_COMPLIANCE_SLOPE, coulomb * slope),
        (Constant.VISCOUS_LOAD_COMPLIANCE, viscous * level),
        (Constant.VISCOUS_LOAD_COMPLIANCE_SLOPE, viscous * slope),
    )
    found = tuple(Change(quantity, value) for quantity, value in changes if value != 0.0)
    if values["reach_m"] > 0.0:
        wind_up = PreslidingWindUp(level, slope, values["friction_share"], values["reach_m"])
        return (*found, wind_up)
    return found


def _empirical_forms(_covered: Covered, baseline: Baseline) -> Iterator[EmpiricalForm]:
    """A spring that carries other shares of the load, and one that dry friction winds up late."""
    for coulomb in _COULOMB_SHARES:
        for viscous in _VISCOUS_SHARES if coulomb else _VISCOUS_SHARES[:1]:
            yield EmpiricalForm("loads", transmission=_windup_by_loads(coulomb, viscous * coulomb))
    for share in TABLE_SHARES:
        for compliance in np.geomspace(3e-9, 3e-7, 9).tolist():
            reach = 2.0 * compliance * share * baseline.coulomb_nm
            late = delayed_friction(reach / baseline.ratio_m_per_rad, share)
            yield EmpiricalForm("late", (late,), (_load_windup(compliance, share),))


def _windup_by_loads(coulomb: float, viscous: float) -> tuple[MotionCurve, MotionCurve]:
    """Wind-up by a compliance that is even, and by one that grows with the position.

    The spring carries a share of the inertia and so many times as great a share of the frictions:
    no load is friction alone.
    """

    def load(motion: Motion, baseline: Baseline) -> Floats:
        friction_nm = coulomb * baseline.coulomb_nm * motion.approach
        friction_nm = friction_nm + viscous * baseline.viscous_nm_s_per_rad * motion.speed_rad_s
        return -baseline.inertia_kg_m2 * motion.table_rad_s2 - friction_nm

    return load, lambda motion, baseline: motion.position_m * load(motion, baseline)


def _load_windup(compliance_m_per_n: float, share: float) -> MotionCurve:
    def curve(motion: Motion, baseline: Baseline) -> Floats:
        load = baseline.table_inertia_kg_m2 * motion.table_rad_s2
        friction_nm = baseline.coulomb_nm * motion.approach
        friction_nm = friction_nm + baseline.viscous_nm_s_per_rad * motion.speed_rad_s
        load = load + share * friction_nm
        return -compliance_m_per_n * load / baseline.ratio_m_per_rad

    return curve


EFFECT = Effect(
    name="compliance",
    description="The drive gives more under load: too stiff a model, or a loose coupling or nut.",
    source="thesis (5.3.1), (5.3.9): x - R theta = -(c_0 + c_1 x) T_load / R",
    kind=Kind.LOST_MOTION,
    parameters=(
        amount("level_m_per_n", "m/N", "More compliance at the fixed bearing.", -1e-6, 1e-5, 2e-8),
        amount("slope_per_n", "1/N", "More compliance per metre from there.", -1e-5, 1e-5, 3e-8),
        friction_share(),
        viscous_share(),
        shape("reach_m", "m", _REACH, 0.0, 1e-4, 0.0, tried=(5e-7, 3e-6)),
    ),
    contributions=_contributions,
    has_one_load=True,
    imitates=frozenset({"presliding", "timestamp_skew"}),
    most_shapes=2,
    most_entries=2,
    trace=Trace(  # what the spring gives more, m/N
        lambda _period_s, _coulomb_nm: (0.0, 2e-10), {"friction_share": 1.0, "viscous_share": 0.0}
    ),
    empirical_forms=_empirical_forms,
)
