"""Preload of drawn axes with one encoder that are tested by shaking, by recordings of the tests.

Three tests while healthy, then one for each case; the rest of the axis, its grease and the data
sheet of its nut are off as on a real one. No axis shares code with what reads it.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from edge_service.estimate.interface import make_estimator
from edge_service.estimate.mixture.state import ASSUMED
from edge_service.estimate.mixture.torque_alone import quantile, weigh
from edge_service.estimate.one_encoder import OneEncoderEstimator
from edge_service.models.commissioned import Notch

from ...estimate.tested_axis import FRESH_PERCENT, drawn, machine_of, notch_of_day, on_a_day
from ...fingerprint.shaken_axis import Axis
from ..table import Table, mean_of

PRELOADS = (1.0, 0.75, 0.5, 0.25, 0.1)
LARGE_SHARE = 0.25
"""Share of the nut in the compliance from which on a test is asked to be worth it."""
STATED = 0.15  # standard deviation of the nut's stated stiffness, a share


@dataclass(frozen=True, slots=True)
class NotchPart:
    """One reading, points; NaN where it was refused, or the axis could not be commissioned."""

    case: str
    axis_seed: int
    share: float
    truth: float
    value: float = math.nan
    low: float = math.nan
    high: float = math.nan
    today: float = math.nan  # width by friction alone, which may be cold or warm


def _cases(axis: Axis, random: np.random.Generator) -> Mapping[str, Axis]:
    half = replace(axis, preload=0.5)
    worn = {f"{preload:g} of fresh": replace(axis, preload=preload) for preload in PRELOADS}
    return worn | {
        "fresh, a third less friction": replace(axis, friction=0.7),
        "half, a third less friction": replace(half, friction=0.7),
        "fresh, 40 % more load": replace(axis, payload_kg=0.4 * axis.table_kg),
        "fresh, the rest softer": replace(axis, softer=float(random.uniform(1.1, 1.6))),
        "half, guides rub twice": replace(half, guide_n=2.0 * axis.guide_n),
    }


def tested(axis_seed: int, quick: bool) -> Iterator[NotchPart]:
    """All cases on one axis; the same seed gives the same one."""
    random = np.random.default_rng([axis_seed, 83])
    axis, rate_hz = drawn(random)
    healthy = [_notch(on_a_day(axis, random), axis_seed + day, rate_hz) for day in range(3)]
    seen = [each for each in healthy if each is not None]
    machine = machine_of(axis, seen, math.exp(STATED * random.standard_normal())) if seen else None
    for case, changed in list(_cases(axis, random).items())[: 3 if quick else None]:
        now = on_a_day(changed, random)
        part = NotchPart(case, axis_seed, axis.share, FRESH_PERCENT * changed.preload)
        notch = _notch(now, axis_seed + 7, rate_hz) if len(seen) == 3 else None
        if machine is None or notch is None:
            yield part
            continue
        estimator = make_estimator("mixture", machine)
        assert isinstance(estimator, OneEncoderEstimator)
        try:
            told = estimator.take_test(notch, 45.0)
        except ValueError:
            yield part
            continue
        assert told.preload_percent is not None and told.low is not None and told.high is not None
        yield replace(
            part,
            value=told.preload_percent,
            low=told.low,
            high=told.high,
            today=_width_today(axis, now),
        )


def _notch(axis: Axis, seed: int, rate_hz: float) -> Notch | None:
    try:
        return notch_of_day(axis, seed, rate_hz)
    except ValueError:
        return None


def _width_today(axis: Axis, now: Axis) -> float:
    """Width of the interval by the level of friction, cold or warm, points."""
    guide_nm = axis.guide_n * axis.radius_m
    level_nm = now.friction * (now.nut_nm * now.preload + now.guide_n * axis.radius_m)
    drifts = (ASSUMED.warmth, ASSUMED.together, ASSUMED.apart)
    weights = weigh(level_nm, 0.01 * level_nm, axis.nut_nm, guide_nm, 0.1, drifts)
    return FRESH_PERCENT * (quantile(0.975, weights) - quantile(0.025, weights))


def notch_table(parts: Sequence[NotchPart]) -> Table:
    """One row for each case and size of the nut's share, and for all preloads of each."""
    rows: list[Mapping[str, object]] = []
    names = dict.fromkeys(part.case for part in parts)
    all_preloads = [name for name in names if name.endswith(" of fresh")]
    groups = {"all these": all_preloads} | {name: [name] for name in names}
    for title, group in groups.items():
        for large in (True, False):
            same = [p for p in parts if p.case in group and (p.share >= LARGE_SHARE) == large]
            read = [part for part in same if math.isfinite(part.value)]
            held = [part.low - 1e-9 <= part.truth <= part.high + 1e-9 for part in read]
            share = f"share {'from' if large else 'below'} {LARGE_SHARE:g}"
            row = {
                "tested by shaking": f"{title}, {share}",
                "read": len(read) / max(len(same), 1),
                "held": mean_of([float(each) for each in held]),
                "width": _median([part.high - part.low for part in read]),
                "width today": _median([part.today for part in read]),
                "MAE": mean_of([abs(part.value - part.truth) for part in read]),
                "MAE of fresh": mean_of([FRESH_PERCENT - part.truth for part in read]),
            }
            rows.append(row)
    seeds = sorted({part.axis_seed for part in parts})
    return Table.of(rows, f"{len(seeds)} axes, seeds {seeds[0]} to {seeds[-1]}")


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else math.nan
