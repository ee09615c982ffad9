"""Maps of the encoders along the stroke: right where the axis has been, unsure beyond."""

import numpy as np
import pytest

from edge_service.estimate.commissioning.phases import SteadyPhases
from edge_service.estimate.commissioning.series_compliance import (
    SeriesCompliance,
    fit_series_compliance,
)
from edge_service.messages.samples import Floats

from ..mixture.mixture_axis import RATIO, STROKE_M, machine

NOISE_M = 3e-8
LOW_M, HIGH_M = 0.3 * STROKE_M, 0.7 * STROKE_M
PER_ACCELERATION_S2 = 1e-6


def uneven(place_m: Floats, size_m: float) -> Floats:
    """An error of the lead, two waves to the stroke."""
    return np.asarray(size_m * np.sin(4.0 * np.pi * place_m / STROKE_M))


def taught(size_m: float, seed: int = 3) -> tuple[SeriesCompliance, Floats]:
    """Fit learned between LOW_M and HIGH_M, and the places of the maps' nodes, (k,)."""
    rng = np.random.default_rng(seed)
    count = 3000
    table_m = rng.uniform(LOW_M, HIGH_M, count)
    direction = rng.choice([-1.0, 1.0], count)
    speed_m_s = direction * rng.uniform(0.05, 0.5, count)
    acceleration_m_s2 = rng.choice([-5.0, 0.0, 5.0], count)
    stretch_m = PER_ACCELERATION_S2 * acceleration_m_s2 + 1e-6 * direction
    stretch_m += uneven(table_m, size_m) + NOISE_M * rng.standard_normal(count)
    phases = SteadyPhases(
        run=np.zeros(count),
        time_s=0.1 * np.arange(count),
        steady_s=np.full(count, 0.1),
        direction=direction,
        torque_nm=np.zeros(count),
        acceleration_rad_s2=acceleration_m_s2 / RATIO,
        speed_rad_s=speed_m_s / RATIO,
        angle_rad=(table_m + stretch_m) / RATIO,
        table_m=table_m,
    )
    found = fit_series_compliance(phases, machine(), lambda places, _: np.zeros_like(places))
    assert found is not None
    return found, np.linspace(0.0, STROKE_M, len(found.lead_map_m))


def test_the_map_is_right_where_the_axis_has_been() -> None:
    """But for a straight line, which the zeros of the encoders and the screw's growth hold."""
    found, nodes = taught(2e-6)
    assert found.per_acceleration_s2 == pytest.approx(PER_ACCELERATION_S2, rel=0.01)
    inside = (nodes > LOW_M + 0.02 * STROKE_M) & (nodes < HIGH_M - 0.02 * STROKE_M)
    off = found.lead_map_m - uneven(nodes, 2e-6)
    line = np.polynomial.Polynomial.fit(nodes[inside], off[inside], 1)
    assert np.abs(off[inside] - line(nodes[inside])).max() < 3e-8
    assert found.map_sigma_m[inside].max() < 5e-8


def test_beyond_it_is_as_at_the_last_place_and_ever_less_sure() -> None:
    found, nodes = taught(2e-6)
    below, above = nodes < LOW_M - 0.03 * STROKE_M, nodes > HIGH_M + 0.03 * STROKE_M
    for beyond in (below, above):
        assert np.ptp(found.lead_map_m[beyond]) < 1e-9
    assert (np.diff(found.map_sigma_m[below]) < 0.0).all()
    assert (np.diff(found.map_sigma_m[above]) > 0.0).all()
    assert found.map_sigma_m[[0, -1]].min() > 5e-7


def test_how_unsure_follows_from_how_uneven_the_screw_is() -> None:
    even, uneven_one = taught(0.0)[0], taught(2e-6)[0]
    assert even.map_sigma_m[[0, -1]].max() < 0.1 * uneven_one.map_sigma_m[[0, -1]].min()
