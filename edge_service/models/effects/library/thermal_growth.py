"""A screw that grows as it warms up; the sensor on the housing follows late."""

from collections.abc import Iterator

import numpy as np

from ....messages.samples import Floats
from ..baseline import Baseline, Motion
from ..contribution import Contribution, Over, Strain, lagged_warming
from ..effect import Effect, Kind, Values, amount, reference_temperature, shape
from ..empirical import Covered, EmpiricalForm, MotionCurve, heat

_HEAT_CELLS = 40
EXPANSION_PER_K = 11.5e-6  # thermal expansion of screw steel


def _contributions(values: Values) -> tuple[Contribution, ...]:
    rise_k, time_constant_s = values["rise_k"], values["time_constant_s"]
    per_k, reference_c = values["strain_per_k"], values["reference_c"]
    parts: list[Contribution] = [lagged_warming(rise_k, time_constant_s)]
    if rise_k:
        most = EXPANSION_PER_K * rise_k
        parts.append(Strain(Over.TIME, lambda time_s: -most * np.expm1(-time_s / time_constant_s)))
    if per_k:
        parts.append(Strain(Over.TEMPERATURE, lambda warm_c: per_k * (warm_c - reference_c)))
    return tuple(parts)


def _empirical_forms(covered: Covered, _baseline: Baseline) -> Iterator[EmpiricalForm]:
    """Growth as motion heats the axis: as a whole, between bearing and nut, or where it runs."""
    for tau_s in covered.time_constants_s:
        yield EmpiricalForm("heat", transmission=(_growth_by_motion(tau_s, 1),))
        yield EmpiricalForm("end", transmission=(_growth_by_motion(tau_s, 0),))
        yield EmpiricalForm("local", transmission=(_local_growth(tau_s),))


def _growth_by_motion(tau_s: float, power: int) -> MotionCurve:
    return lambda motion, _: motion.position_m**power * heat(motion, tau_s)


def _local_growth(tau_s: float) -> MotionCurve:
    """Growth of a screw that is heated where the nut runs, without conduction."""

    def curve(motion: Motion, _baseline: Baseline) -> Floats:
        from scipy.signal import lfilter  # 45 MB that a service without a diagnosis does without

        low, high = float(motion.position_m.min()), float(motion.position_m.max())
        width = max(high - low, 1e-6) / _HEAT_CELLS
        step = max(round(0.05 / float(motion.time_s[1] - motion.time_s[0])), 1)
        position, speed = motion.position_m[::step], np.abs(motion.speed_rad_s[::step])
        cell = np.clip(((position - low) / width).astype(int), 0, _HEAT_CELLS - 1)
        keep = float(np.exp(-step * float(motion.time_s[1] - motion.time_s[0]) / tau_s))
        gained = np.zeros((len(cell), _HEAT_CELLS))
        gained[np.arange(len(cell)), cell] = speed * (1.0 - keep)
        warm = lfilter([1.0], [1.0, -keep], gained, axis=0)
        below = np.cumsum(warm, axis=1) - 0.5 * warm
        grown = below[np.arange(len(cell)), cell] * width
        scale = max(float(np.abs(grown).max()), 1e-30)
        reached: Floats = grown / scale * max(high, 1e-3)
        return np.asarray(np.interp(motion.time_s, motion.time_s[::step], reached))

    return curve


EFFECT = Effect(
    name="thermal_growth",
    description="The screw grows while it warms up and carries the table away from its bearing.",
    source=(
        "x = R theta (1 + alpha dT (1 - exp(-t / tau))), alpha = 11.5e-6 per K; where a "
        "temperature is recorded, growth in proportion to it"
    ),
    kind=Kind.TRAVEL,
    parameters=(
        amount("rise_k", "K", "Final temperature rise of the screw.", -50.0, 100.0, 10.0),
        amount(
            "strain_per_k",
            "1/K",
            "Growth for each K by which the housing is warmer than the reference.",
            -1e-4,
            1e-4,
            0.0,
        ),
        shape(
            "time_constant_s", "s", "Time to 63 % of rise.", 1.0, 1e5, 900.0, amounts=("rise_k",)
        ),
        reference_temperature("strain_per_k"),
    ),
    contributions=_contributions,
    is_thermal=True,
    most_entries=2,
    empirical_forms=_empirical_forms,
)
