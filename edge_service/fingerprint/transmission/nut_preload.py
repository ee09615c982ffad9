"""Preload of the nut, from the drag (4.3.6) and from a change of the series stiffness (5.3.11)."""

import math
from collections.abc import Mapping
from dataclasses import replace

from ...models.machine import Machine, Quantity
from ...models.screw.nut_law import preload_ratio
from ...regression.interval_estimate import IntervalEstimate, normal_quantile, undetermined
from ..result import Contents

DRAG_FACTOR_TOLERANCE = 0.1
"""Drag of one preload differs by 20 % between screws (Table A.1), taken as two deviations."""


def measure_preload(
    coulomb: IntervalEstimate | None,
    stiffness: Mapping[str, IntervalEstimate],
    fresh_stiffness: Mapping[str, IntervalEstimate],
    machine: Machine,
) -> Contents:
    """Preload from the drag (4.3.6) and from the change of the stiffness (5.3.11)."""
    model, found = machine.model, []
    if model.preload_n is None:
        change = undetermined("N", "model.preload_n is missing")
    elif not fresh_stiffness:
        change = undetermined("N", "needs the stored fingerprint of the fresh axis (--baseline)")
    else:
        for name in sorted(stiffness.keys() & fresh_stiffness.keys()):
            if name.startswith("stiffness_"):
                both = stiffness[name], fresh_stiffness[name]
                nut = model.nut_stiffness_n_per_m
                found.append(preload_from_stiffness(*both, model.preload_n, nut))
        # where the screw's own compliance disturbs least the interval is the tightest
        unknown = undetermined("N", "the stiffness is undetermined")
        change = min(found, key=lambda each: each.high - each.low, default=unknown)
    drag = preload_from_drag_level(coulomb, machine)
    return {"preload_from_drag_n": drag, "preload_from_stiffness_n": change}, ()


def preload_from_drag_level(coulomb: IntervalEstimate | None, machine: Machine) -> IntervalEstimate:
    """Preload from the Coulomb level less what guides and bearings rub, N.

    The fresh screw's pair of drag and preload gives the ratio. Where the machine file does not say
    what else rubs, all of the level may be the screw's or none of it.
    """
    model = machine.model
    if coulomb is None or not coulomb.determined:
        return undetermined("N", "the Coulomb level is undetermined")
    if model.preload_n is None or not model.preload_drag_nm or not model.preload_drag_nm.value:
        return undetermined("N", "model.preload_n or model.preload_drag_nm is missing")
    newton_per_nm = model.preload_n.value / model.preload_drag_nm.value
    others = machine.other_drag_nm
    screw_nm = coulomb.value - others.value
    shares = (model.preload_n.tolerance, model.preload_drag_nm.tolerance, DRAG_FACTOR_TOLERANCE)
    sigma = newton_per_nm * math.hypot(coulomb.sigma, others.sigma, screw_nm * math.hypot(*shares))
    value, half = newton_per_nm * screw_nm, normal_quantile() * sigma
    low, high = max(value - half, 0.0), max(value + half, 0.0)
    found = IntervalEstimate(value, low, high, "N", coulomb.n_effective)
    if {"guide_force_n", "bearing_drag_nm"} & model.model_fields_set:
        return found
    note = "model.guide_force_n and bearing_drag_nm are unknown: an upper bound"
    return replace(found, low=0.0, note=note)


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
    if not all(each.determined and each.low > 0.0 for each in (stiffness, fresh_stiffness)):
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
    changes = (change - half, change + half)
    ratios = [preload_ratio(each, nut) for each in changes for nut in (nut_low, nut_high)]
    spread = normal_quantile() * fresh_preload_n.sigma
    low = max(fresh_preload_n.value - spread, 0.0) * min(ratios)
    high = (fresh_preload_n.value + spread) * max(ratios)
    return IntervalEstimate(value, low, high, "N", count, note)
