"""Tests of what the soak makes of its readings."""

import pytest

from .soak import Look, slope_per_h


def looks(growth_bytes_per_s: float) -> list[Look]:
    """Readings that rise for a quarter of the time, and then by a rate."""
    times = [10.0 * k for k in range(40)]
    warm = 100.0
    return [
        Look(t, round(5e6 * min(t, warm) + growth_bytes_per_s * max(t - warm, 0.0)), 20, 9, 0)
        for t in times
    ]


@pytest.mark.parametrize("growth_bytes_per_s", [0.0, 250.0, -250.0])
def test_growth_is_that_after_the_warm_up(growth_bytes_per_s: float) -> None:
    slope = slope_per_h(looks(growth_bytes_per_s), "rss_bytes")
    assert slope == pytest.approx(3600.0 * growth_bytes_per_s, abs=5e3)


def test_what_does_not_change_does_not_grow() -> None:
    assert slope_per_h(looks(250.0), "descriptors") == pytest.approx(0.0, abs=1e-9)
