"""Hysteresis, which remembers the way it came: play, and the bristles of presliding friction."""

import numpy as np
import numpy.typing as npt

from ...messages.samples import Floats
from ..compiled import compiled
from ..plant.dry_friction import Levels, bristle_stiffness


@compiled
def play(travel_m: Floats, width_m: float, ahead: npt.NDArray[np.int8]) -> Floats:
    """Position of what is pushed through a play of `width_m`, m, (n,).

    It begins in touch with the flank of positive motion, follows that without a gap, and lags a
    motion backwards by the width (Krasnosel'skii and Pokrovskii, Systems with Hysteresis, 1989).
    Where its own load throws it ahead (1: of a motion forwards, -1: backwards) it lies on the other
    flank; afterwards it stays where it is until a flank comes and takes it along.
    """
    pushed = np.empty_like(travel_m)
    latest = travel_m[0] if travel_m.shape[0] else 0.0
    for k in range(travel_m.shape[0]):
        latest = min(max(latest, travel_m[k]), travel_m[k] + width_m)
        if ahead[k] > 0:
            latest = travel_m[k] + width_m
        elif ahead[k] < 0:
            latest = travel_m[k]
        pushed[k] = latest
    return pushed


@compiled
def bristle_share(travel_m: Floats, reach_m: float) -> Floats:
    """Presliding friction over its level, -1 to 1, (n,); home was approached forwards, unloaded.

    The bristle of `dry_friction.bristle_stiffness`, integrated over the travel in steps of at most
    a tenth of the reach; beyond ten reaches it has reached its level.
    """
    share = np.empty_like(travel_m)
    held = 0.0
    for k in range(travel_m.shape[0]):
        way = travel_m[k] - travel_m[k - 1] if k else 0.0
        if abs(way) > 10.0 * reach_m:
            held = 1.0 if way > 0.0 else -1.0
        else:
            steps = int(abs(way) / (0.1 * reach_m)) + 1
            levels = Levels(1.0, 1.0, reach_m)
            for _ in range(steps):
                before = held
                held += bristle_stiffness(levels, held, way) * way / steps
                held = min(max(held, -1.0), 1.0)
                if held == before:
                    break
        share[k] = held
    return share
