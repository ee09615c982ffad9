"""Lost motion between screw and table.

Only friction holds a table within its play: where the machine file states no `guide_force_n`, a
twentieth of the Coulomb level acts on the simulated table. With shares of 0 it hunts and rattles.
"""

from collections.abc import Iterator

import numpy as np

from ....messages.samples import Floats
from ..baseline import Baseline, Motion
from ..contribution import Play
from ..effect import Effect, Kind, Parameter, Role, friction_share, viscous_share
from ..empirical import TABLE_SHARES, Covered, EmpiricalForm, MotionCurve, delayed_friction
from ..hysteresis import play


def _empirical_forms(_covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    """Play that closes late, while the table's friction builds up."""
    for share in TABLE_SHARES:
        for width in np.geomspace(2e-6, 6e-5, 9).tolist():
            yield EmpiricalForm(
                "late", (delayed_friction(width, share),), (_load_side_play(width),)
            )


def _load_side_play(width_m: float) -> MotionCurve:
    """Play whose flank is that of the load: a table that brakes leans on the other flank."""

    def curve(motion: Motion, baseline: Baseline) -> Floats:
        travel = baseline.ratio_m_per_rad * motion.angle_rad
        load = baseline.table_inertia_kg_m2 * motion.table_rad_s2
        load = load + 0.5 * baseline.coulomb_nm * motion.approach
        ahead = np.where(load * motion.approach < 0.0, motion.approach, 0.0).astype(np.int8)
        return play(travel, width_m, ahead) - travel

    return curve


EFFECT = Effect(
    name="backlash",
    description="At a reversal the motor turns before the table moves: there is clearance.",
    source="play operator; flanks touch after positive motion, so x - R theta is 0 or the width",
    kind=Kind.LOST_MOTION,
    parameters=(
        Parameter("width_m", "m", "Clearance.", 0.0, 2e-3, 0.0, 1e-5, Role.SHAPE),
        friction_share(0.1, 0.4, 0.8, 1.2, 2.4, 0.0, most=4.0),  # the first must show
        viscous_share(0.0, 0.4, 1.0),
    ),
    contributions=lambda values: (
        Play(values["width_m"], values["friction_share"], values["viscous_share"]),
    ),
    rests_anywhere=True,
    imitates=frozenset({"compliance", "presliding"}),  # widths add up to what a spring does
    most_shapes=3,
    most_entries=1,
    empirical_forms=_empirical_forms,
)
