"""Preload of the nut from a change of the axis' series stiffness (thesis, 5.3.11)."""

import math

from ...models.machine import Quantity
from ...models.screw.nut_law import preload_ratio
from ...regression.interval_estimate import IntervalEstimate, normal_quantile, undetermined


def preload_from_stiffness(
    stiffness: IntervalEstimate,
    fresh_stiffness: IntervalEstimate,
    fresh_preload_n: Quantity,
    fresh_nut_stiffness_n_per_m: Quantity | None,
) -> IntervalEstimate:
    """Preload from how the series stiffness at one place has changed since it was known, N.

    Only the nut depends on the preload, K_n ~ F^(1/3) (5.3.11), so with c = 1 / K_n and dC the
    change of the compliance, F / F_fresh = (1 + dC / c_fresh)^-3. Of c_fresh only that it is no
    more than the fresh series compliance is sure; without the nut's stiffness the interval runs
    over all shares.

    Args:
        stiffness: now, N/m.
        fresh_stiffness: at the same place with the fresh preload, N/m.
        fresh_nut_stiffness_n_per_m: of the nut alone with the fresh preload.
    """
    count = min(stiffness.n_effective, fresh_stiffness.n_effective)
    if not _bounded(stiffness) or not _bounded(fresh_stiffness):
        return undetermined("N", "the stiffness is undetermined", count)
    change = 1.0 / stiffness.value - 1.0 / fresh_stiffness.value
    half = normal_quantile() * math.hypot(
        stiffness.sigma / stiffness.value**2, fresh_stiffness.sigma / fresh_stiffness.value**2
    )
    whole = 1.0 / fresh_stiffness.low
    if fresh_nut_stiffness_n_per_m is None:
        value, nut_low, nut_high = math.nan, 0.0, whole
        note = "the nut's share of the compliance is unknown (model.nut_stiffness_n_per_m)"
    else:
        nut = fresh_nut_stiffness_n_per_m
        share = normal_quantile() * nut.sigma
        nut_high = min(1.0 / max(nut.value - share, 1e-9), whole)
        nut_low = min(1.0 / (nut.value + share), nut_high)
        value = fresh_preload_n.value * preload_ratio(change, min(1.0 / nut.value, whole))
        note = ""
    ratios = [
        preload_ratio(change + side * half, nut)
        for side in (-1.0, 1.0)
        for nut in (nut_low, nut_high)
    ]
    spread = normal_quantile() * fresh_preload_n.sigma
    return IntervalEstimate(
        value,
        max(fresh_preload_n.value - spread, 0.0) * min(ratios),
        (fresh_preload_n.value + spread) * max(ratios),
        "N",
        count,
        note,
    )


def _bounded(stiffness: IntervalEstimate) -> bool:
    return stiffness.determined and stiffness.low > 0.0
