"""Bounds of a verdict that a reader should know: noise that hides faults, and what is left."""

import math
from collections.abc import Mapping

from ..result import ChannelGap, Verdict
from ..session.session import CHANNEL_UNITS, TORQUE_GAP

BLIND_SHARE = 0.5
"""Of the torque itself: a floor beyond that hides any fault of the size of the torque."""
IMPRECISE = 0.1
"""Of the gap: a remainder up to it may be but the way in which an entry simplifies its effect."""
_SPOKEN = {TORQUE_GAP: "torque", "transmission_m": "position between motor and table"}


def is_blind(floor_nm: float, torque_nm: float) -> bool:
    """Tell whether a floor is so much of the torque itself that it hides whatever matters."""
    return floor_nm > BLIND_SHARE * torque_nm


def caveats_of(
    gap: Mapping[str, ChannelGap], left: Mapping[str, float], torque_nm: float, verdict: Verdict
) -> tuple[str, ...]:
    """Lines about what the verdict leaves open.

    Args:
        left: root mean square that the causes leave, and what a healthy axis may have, by channel.
        torque_nm: root mean square of the torque in motion.
    """
    found = []
    if TORQUE_GAP in gap and is_blind(gap[TORQUE_GAP].noise_floor, torque_nm):
        floor_nm = gap[TORQUE_GAP].noise_floor
        found.append(
            f"{floor_nm:.3g} of {torque_nm:.3g} N m of torque cannot be predicted from the motion "
            "or from a repeat of it: a fault of that size would go unnoticed"
        )
    if verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS):
        found += [
            f"{_SPOKEN[name]}: {beyond:.3g} {CHANNEL_UNITS[name]} beyond the floor are left, more "
            f"than the {each.tolerance:.3g} {CHANNEL_UNITS[name]} tolerated: there may be causes "
            "beyond those named"
            for name, each in gap.items()
            for beyond in (math.sqrt(max(left[name] ** 2 - each.noise_floor**2, 0.0)),)
            if beyond > max(each.tolerance, IMPRECISE * each.before)
        ]
    return tuple(found)
