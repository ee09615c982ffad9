"""Antiresonance by shaking on a slow feed, against an axis that shares no code with it."""

from dataclasses import replace

import numpy as np
import pytest

from edge_service.fingerprint.response.notch import notch_of
from edge_service.models.commissioned import Notch

from .shaken_axis import STEP_S, Axis, driven, shaken, smooth

AXIS = Axis()
HALF = replace(AXIS, preload=0.5)
"""A nut of a quarter of the compliance with half of its preload: 2^(1/3) as soft."""
HALF_HZ = AXIS.antiresonance_hz * (0.75 + 0.25 * 2.0 ** (1.0 / 3.0)) ** -0.5


def seen(axis: Axis, rate_hz: float = 1000.0) -> Notch:
    found = notch_of(shaken(axis, 3, rate_hz))
    assert found is not None
    return found


@pytest.mark.parametrize("rate_hz", [500.0, 1000.0, 2000.0])
def test_the_antiresonance_is_found_and_falls_with_the_preload_by_the_cube_root(
    rate_hz: float,
) -> None:
    fresh, worn = seen(AXIS, rate_hz), seen(HALF, rate_hz)
    assert fresh.antiresonance_hz == pytest.approx(AXIS.antiresonance_hz, rel=0.01)
    assert worn.antiresonance_hz / fresh.antiresonance_hz == pytest.approx(
        HALF_HZ / AXIS.antiresonance_hz, rel=0.002
    )
    table = AXIS.table_kg * AXIS.radius_m**2 / AXIS.inertia_kg_m2
    assert fresh.inertia_ratio == pytest.approx(table, rel=0.08)
    assert fresh.damping_ratio == pytest.approx(AXIS.damping, rel=0.15)
    friction_nm = AXIS.nut_nm + AXIS.guide_n * AXIS.radius_m
    assert fresh.friction_nm == pytest.approx(friction_nm, rel=0.05)
    assert fresh.feed_rad_s == pytest.approx(0.02 / AXIS.radius_m, rel=0.02)


@pytest.mark.parametrize(
    "change",
    [
        {"friction": 0.65},
        {"guide_n": 120.0},
        {"torque_factor": 0.96},
        {"feedforward": False},
        {"hanging_n": 300.0},
    ],
    ids=str,
)
def test_neither_grease_nor_warmth_nor_the_torque_constant_moves_it(
    change: dict[str, float],
) -> None:
    changed = replace(AXIS, **change)  # type: ignore[arg-type]
    expected = (changed.stiffness() / changed.table_kg) ** 0.5 / 2.0 / np.pi
    found = seen(changed).antiresonance_hz / seen(AXIS).antiresonance_hz
    assert found == pytest.approx(expected / AXIS.antiresonance_hz, rel=0.004)


def test_a_payload_shows_in_the_ratio_of_the_inertias() -> None:
    heavier = replace(AXIS, payload_kg=18.0)
    ratio = seen(heavier).inertia_ratio / seen(AXIS).inertia_ratio
    assert ratio == pytest.approx(1.3, rel=0.03)
    assert seen(heavier).antiresonance_hz < 0.9 * seen(AXIS).antiresonance_hz


@pytest.mark.parametrize(
    ("axis", "how", "reason"),
    [
        (AXIS, {"feed_m_s": 0.0}, "reversed or stood"),
        (AXIS, {"speed_share": 1.4}, "reversed or stood"),
        (replace(AXIS, antiresonance_hz=171.0), {"rate_hz": 500.0}, "needs 5.. samples/s"),
        (replace(AXIS, base_kg=600.0, base_hz=130.0), {}, "a second mode"),
        (
            replace(AXIS, feedforward=False, antiresonance_hz=222.0),
            {},
            "coherence of|no antiresonance",
        ),
    ],
    ids=["no feed", "turns back", "too slow a rate", "a bed beside it", "hardly shaken"],
)
def test_a_test_that_cannot_tell_is_refused(axis: Axis, how: dict[str, float], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        notch_of(shaken(axis, 3, **how))


def test_neither_production_nor_standstill_is_a_test() -> None:
    speed = [0.0, 0.3, 0.3, 0.0, -0.2, -0.2, 0.0, 0.05, *([0.02] * 6), 0.0, -0.3, 0.0] * 2
    assert notch_of(driven(AXIS, smooth(speed), 1)) is None
    assert notch_of(driven(AXIS, np.zeros(round(10.0 / STEP_S)), 1)) is None
