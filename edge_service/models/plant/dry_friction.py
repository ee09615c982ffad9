"""One step of dry friction in a compiled plant: slide, stick at exactly zero, or bend a bristle."""

from typing import NamedTuple

from ..compiled import compiled

BRISTLE_ELASTIC_SHARE = 0.5
"""Share of the friction level up to which a bristle is elastic (assumption)."""


class Levels(NamedTuple):
    """Dry friction that one mass meets in one step, N, not negative, and its presliding reach."""

    forward_n: float  # greatest friction against motion in either direction
    backward_n: float
    reach_m: float  # level over presliding stiffness; 0.0 sticks without presliding


@compiled
def rub(
    levels: Levels, impulse: float, mass: float, step_s: float, held_n: float, speed_m_s: float
) -> tuple[float, float]:
    """Speed at the end of a step, m/s, and the friction throughout it, N against positive motion.

    `impulse` is the momentum, kg m/s, that the mass would have at the end without dry friction,
    `held_n` and `speed_m_s` are friction and speed at the beginning.
    """
    if levels.reach_m > 0.0:
        return _bend_or_slide(levels, impulse, mass, step_s, held_n, speed_m_s)
    if impulse > step_s * levels.forward_n:
        return (impulse - step_s * levels.forward_n) / mass, levels.forward_n
    if impulse < -step_s * levels.backward_n:
        return (impulse + step_s * levels.backward_n) / mass, -levels.backward_n
    return 0.0, impulse / step_s


@compiled
def _bend_or_slide(
    levels: Levels, impulse: float, mass: float, step_s: float, held_n: float, speed_m_s: float
) -> tuple[float, float]:
    """Presliding: an elastic predictor, implicit in the end's speed, cut off at the levels."""
    held = min(max(held_n, -levels.backward_n), levels.forward_n)
    way = speed_m_s + (impulse - step_s * held) / mass
    stiffness = bristle_stiffness(levels, held, way)
    start = impulse - step_s * (held + 0.5 * step_s * stiffness * speed_m_s)
    after = start / (mass + 0.5 * step_s * step_s * stiffness)
    force = held + 0.5 * step_s * stiffness * (speed_m_s + after)
    if force > levels.forward_n:
        return (impulse - step_s * levels.forward_n) / mass, levels.forward_n
    if force < -levels.backward_n:
        return (impulse + step_s * levels.backward_n) / mass, -levels.backward_n
    return after, force


@compiled
def bristle_stiffness(levels: Levels, held_n: float, way: float) -> float:
    """Presliding stiffness, N/m, of friction `held_n` when the motion has the sign of `way`.

    Elasto-plastic bristle (Dupont, Hayward, Armstrong and Altpeter, 2002): elastic, and so without
    drift, while it resists less than `BRISTLE_ELASTIC_SHARE` of its level or is being relieved;
    beyond that its stiffness falls to zero at the level.
    """
    level = levels.forward_n if way >= 0.0 else levels.backward_n
    loaded = held_n if way >= 0.0 else -held_n
    elastic = BRISTLE_ELASTIC_SHARE * level
    if loaded <= elastic:
        return level / levels.reach_m
    return level * max(level - loaded, 0.0) / (level - elastic) / levels.reach_m
