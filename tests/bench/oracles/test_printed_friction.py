import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.models.screw.friction import exponential_friction

from .printed_friction import DirectionalFriction, Friction

GUIDE = Friction(
    coulomb_n=60.0,
    breakaway_n=95.0,
    stribeck_speed_m_s=0.01,
    coulomb_speed_m_s=2e-4,
    viscous_n_s_per_m=300.0,
)
SPEEDS_M_S = np.linspace(-0.2, 0.2, 4001)


@st.composite
def frictions(draw: st.DrawFn) -> Friction:
    coulomb_n = draw(st.floats(0.0, 500.0))
    return Friction(
        coulomb_n=coulomb_n,
        breakaway_n=coulomb_n + draw(st.floats(0.0, 500.0)),
        stribeck_speed_m_s=draw(st.floats(1e-4, 0.1)),
        coulomb_speed_m_s=draw(st.floats(1e-5, 0.01)),
        viscous_n_s_per_m=draw(st.floats(0.0, 1000.0)),
    )


def test_stribeck_part_peaks_at_its_speed_over_root_two_with_the_whole_excess() -> None:
    speeds = np.linspace(0.0, 0.05, 500_001)
    part = GUIDE.stribeck_n(speeds)
    assert np.max(part) == pytest.approx(95.0 - 60.0, rel=1e-9)
    assert speeds[np.argmax(part)] == pytest.approx(0.01 / math.sqrt(2.0), abs=2e-7)
    assert GUIDE.breakaway_speed_m_s == pytest.approx(0.01 / math.sqrt(2.0))


def test_parts_are_the_printed_formulas() -> None:
    v = 0.013
    stribeck = math.sqrt(2.0 * math.e) * 35.0 * math.exp(-(1.3**2)) * 1.3
    assert GUIDE.stribeck_n(v) == pytest.approx(stribeck)
    offset = replace(GUIDE, offset_n=-4.0)
    assert offset.coulomb_part_n(1e-4) == pytest.approx(60.0 * math.tanh(0.5) - 4.0)
    assert GUIDE.viscous_n(v) == pytest.approx(3.9)
    assert offset.force_n(v) == pytest.approx(stribeck + 60.0 - 4.0 + 3.9)


def test_at_rest_nothing_sticks_and_only_the_offset_is_left() -> None:
    assert GUIDE.force_n(0.0) == 0.0
    assert replace(GUIDE, offset_n=7.0).force_n(0.0) == 7.0
    push_n = 1e-3
    creep_m_s = push_n / float(GUIDE.slope_n_s_per_m(0.0))
    assert GUIDE.force_n(creep_m_s) == pytest.approx(push_n, rel=1e-6)


@settings(deadline=None)
@given(friction=frictions(), speed_m_s=st.floats(-1.0, 1.0))
def test_without_offset_it_is_odd_and_takes_energy(friction: Friction, speed_m_s: float) -> None:
    force_n = float(friction.force_n(speed_m_s))
    assert float(friction.force_n(-speed_m_s)) == -force_n
    assert force_n * speed_m_s >= 0.0


@settings(deadline=None)
@given(friction=frictions(), speed_m_s=st.floats(-0.5, 0.5))
def test_slope_is_the_derivative(friction: Friction, speed_m_s: float) -> None:
    """Complex-step derivative: Im F(v + i h) / h, without cancellation."""
    by_complex_step = friction.force_n(np.array(speed_m_s + 1e-30j)).imag / 1e-30
    slope = friction.slope_n_s_per_m(speed_m_s)
    assert slope == pytest.approx(float(by_complex_step), rel=1e-6, abs=1e-6)


@settings(deadline=None)
@given(friction=frictions())
def test_more_breakaway_never_means_less_friction(friction: Friction) -> None:
    more = replace(friction, breakaway_n=friction.breakaway_n + 10.0)
    speeds = np.linspace(0.0, 1.0, 101)
    assert np.all(more.force_n(speeds) >= friction.force_n(speeds))


def test_slope_falls_below_zero_just_above_breakaway_only_with_a_stribeck_peak() -> None:
    slow = replace(GUIDE, viscous_n_s_per_m=0.0)
    assert slow.slope_n_s_per_m(1.5 * slow.breakaway_speed_m_s) < 0.0
    flat = replace(GUIDE, breakaway_n=60.0)
    assert np.all(flat.slope_n_s_per_m(SPEEDS_M_S) > 0.0)


def test_each_direction_has_its_own_constants() -> None:
    back = replace(GUIDE, coulomb_n=50.0, breakaway_n=50.0, viscous_n_s_per_m=450.0)
    both = DirectionalFriction(GUIDE, back)
    force_n, slope = both.force_n(SPEEDS_M_S), both.slope_n_s_per_m(SPEEDS_M_S)
    forward = SPEEDS_M_S > 0.0
    assert np.array_equal(force_n[forward], GUIDE.force_n(SPEEDS_M_S[forward]))
    assert np.array_equal(force_n[SPEEDS_M_S < 0.0], back.force_n(SPEEDS_M_S[SPEEDS_M_S < 0.0]))
    assert both.force_n(0.0) == 0.0
    assert slope[0] == pytest.approx(450.0)
    assert slope[-1] == pytest.approx(300.0)


def test_equal_directions_are_one_friction() -> None:
    both = DirectionalFriction(GUIDE, GUIDE)
    assert np.array_equal(both.force_n(SPEEDS_M_S), GUIDE.force_n(SPEEDS_M_S))


def test_printed_and_exponential_stribeck_cross_once_at_a_known_speed() -> None:
    """sqrt(2 e) u exp(-u^2) = exp(-u^2) at u = 1 / sqrt(2 e) only."""
    printed = replace(GUIDE, viscous_n_s_per_m=0.0)
    share = np.linspace(0.01, 3.0, 300)
    speeds = share * printed.stribeck_speed_m_s
    other = exponential_friction(speeds, 0.0, 35.0, printed.stribeck_speed_m_s)
    above = printed.stribeck_n(speeds) > other
    assert np.array_equal(above, share > 1.0 / math.sqrt(2.0 * math.e))


@pytest.mark.parametrize(
    ("constants", "word"),
    [
        ({"coulomb_n": -1.0}, "coulomb_n"),
        ({"breakaway_n": 59.0}, "breakaway_n"),
        ({"breakaway_n": math.inf}, "breakaway_n"),
        ({"stribeck_speed_m_s": 0.0}, "stribeck_speed_m_s"),
        ({"coulomb_speed_m_s": math.nan}, "coulomb_speed_m_s"),
        ({"viscous_n_s_per_m": -1.0}, "viscous_n_s_per_m"),
        ({"offset_n": math.nan}, "offset_n"),
    ],
)
def test_impossible_constants_are_named(constants: dict[str, float], word: str) -> None:
    with pytest.raises(ValueError, match=f"^{word} must [^\n]*$"):
        replace(GUIDE, **constants)


def test_offset_cannot_turn_with_the_direction() -> None:
    with pytest.raises(ValueError, match=r"^offset_n must be the same[^\n]*$"):
        DirectionalFriction(GUIDE, replace(GUIDE, offset_n=1.0))
