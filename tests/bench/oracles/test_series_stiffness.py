import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.models.machine import Machine, Quantity
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import axial_compliance
from edge_service.models.screw.nut_law import LEAST_NUT_LOAD_PERCENT, nut_stiffness
from edge_service.models.screw.stiffness import (
    axial_stiffness_of_torsion,
    screw_compliance,
    screw_torsional_rigidity,
)

from .series_stiffness import (
    AxialSprings,
    in_series,
    preload_from_nut_stiffness,
    preloaded_nut,
    series_stiffness,
    springs_of,
)

RIGID = Quantity(value=1e18, tolerance=0.0)
RIGIDITY_N, LENGTH_M = 6.4e7, 0.998
POSITIONS_M = np.linspace(0.0, LENGTH_M, 41)
SCREW_ALONE = AxialSprings(
    coupling_nm_per_rad=RIGID,
    screw_rigidity_n=Quantity(value=RIGIDITY_N, tolerance=0.1),
    screw_length_m=LENGTH_M,
    bearing_arrangement="fixed-free",
    bearing_n_per_m=RIGID,
    nut_n_per_m=RIGID,
    ratio_m_per_rad=0.02 / (2.0 * math.pi),
)


def spring(value: float, tolerance: float = 0.0) -> Quantity:
    return Quantity(value=value, tolerance=tolerance)


@pytest.mark.parametrize(
    ("odd_one", "expected", "change"),
    [
        (1000.0, 250.0, 0.0),  # (5.3.3)
        (2000.0, 285.714, 0.14),  # (5.3.4), printed 285
        (500.0, 200.0, -0.20),  # (5.3.5), printed as "an increase"
        (10_000.0, 322.581, 0.29),
        (100.0, 76.923, -0.69),  # printed 70 %
    ],
)
def test_four_springs_of_the_thesis(odd_one: float, expected: float, change: float) -> None:
    series = in_series([spring(odd_one), *[spring(1000.0)] * 3])
    assert series.value == pytest.approx(expected, rel=1e-5)
    assert series.value / 250.0 - 1.0 == pytest.approx(change, abs=0.005)


@settings(deadline=None)
@given(st.lists(st.tuples(st.floats(1e3, 1e12), st.floats(0.0, 1.0)), min_size=1, max_size=8))
def test_series_is_softer_than_its_softest_and_surer_than_its_least_sure(
    parts: list[tuple[float, float]],
) -> None:
    series = in_series([spring(value, tolerance) for value, tolerance in parts])
    softest = min(value for value, _ in parts)
    assert softest / len(parts) * (1.0 - 1e-9) <= series.value <= softest * (1.0 + 1e-9)
    assert series.tolerance <= max(tolerance for _, tolerance in parts) + 1e-12


def test_tolerance_of_a_series_is_the_spread_of_many_draws() -> None:
    values, tolerances = np.array([1e8, 1.6e8, 4e8]), np.array([0.04, 0.02, 0.05])
    random = np.random.default_rng(11)
    draws = values * (1.0 + tolerances * random.standard_normal((200_000, 3)))
    stiffness = 1.0 / np.sum(1.0 / draws, axis=1)
    series = in_series([spring(*pair) for pair in zip(values, tolerances, strict=True)])
    assert series.sigma == pytest.approx(float(np.std(stiffness)), rel=0.02)


def test_coupling_of_the_bench_through_the_lead() -> None:
    """Table A.5: 67.2 N m per degree; twist by energy, k phi^2 / 2 = K x^2 / 2."""
    per_radian, ratio = 67.2 * 180.0 / math.pi, 0.02 / (2.0 * math.pi)
    twist_rad = 1e-3
    energy_j = 0.5 * per_radian * twist_rad**2
    axial = axial_stiffness_of_torsion(per_radian, ratio)
    assert 0.5 * axial * (ratio * twist_rad) ** 2 == pytest.approx(energy_j)
    assert axial == pytest.approx(3.8e8, rel=0.001)


@pytest.mark.parametrize(("arrangement", "far"), [("fixed-free", 0.0), ("fixed-fixed", 1.0)])
def test_rigid_surroundings_leave_the_printed_screw(arrangement: str, far: float) -> None:
    springs = replace(SCREW_ALONE, bearing_arrangement=arrangement)
    curve = series_stiffness(springs, POSITIONS_M[1:-1])
    expected = [1.0 / screw_compliance(a, RIGIDITY_N, LENGTH_M, far) for a in POSITIONS_M[1:-1]]
    np.testing.assert_allclose(curve.stiffness_n_per_m, expected, rtol=1e-6)


def test_screw_held_at_both_ends_is_twice_as_stiff_in_the_middle_and_four_times_the_free_end() -> (
    None
):
    both = replace(SCREW_ALONE, bearing_arrangement="fixed-fixed")
    middle, end = np.array([0.5 * LENGTH_M]), np.array([LENGTH_M])
    held = series_stiffness(both, middle).stiffness_n_per_m
    np.testing.assert_allclose(held / series_stiffness(SCREW_ALONE, middle).stiffness_n_per_m, 2.0)
    np.testing.assert_allclose(held / series_stiffness(SCREW_ALONE, end).stiffness_n_per_m, 4.0)


def arranged(machine: Machine, arrangement: str) -> Machine:
    axis = machine.axis.model_copy(update={"bearing_arrangement": arrangement})
    return machine.model_copy(update={"axis": axis})


@pytest.mark.parametrize("arrangement", ["fixed-free", "fixed-fixed"])
def test_curve_is_the_compliance_of_the_plant(machine: Machine, arrangement: str) -> None:
    machine = arranged(machine, arrangement)
    percent = machine.fresh_preload_percent
    assert percent is not None
    plant = plant_of(machine)
    curve = series_stiffness(springs_of(machine, spring(percent)), POSITIONS_M)
    expected = [1.0 / axial_compliance(plant, a, percent) for a in POSITIONS_M]
    np.testing.assert_allclose(curve.stiffness_n_per_m, expected, rtol=1e-12)


@pytest.mark.parametrize(("arrangement", "ends"), [("fixed-free", 1), ("fixed-fixed", 2)])
@pytest.mark.parametrize("position_m", [0.0, 0.16, 0.499, 0.7, LENGTH_M])
def test_plant_by_hand(machine: Machine, arrangement: str, ends: int, position_m: float) -> None:
    """(5.3.2) with the arms of (5.3.9) and (5.3.10) behind bearings of 1e8 N/m; Table A.5."""
    arms_m = (position_m, LENGTH_M - position_m)[:ends]
    rigidity_n = 2.06e11 * math.pi * 0.02**2 / 4.0
    held_n_per_m = sum(1.0 / (1.0 / 1e8 + arm_m / rigidity_n) for arm_m in arms_m)
    coupling_n_per_m = 67.2 * 180.0 / math.pi / (0.02 / (2.0 * math.pi)) ** 2
    nut_n_per_m = 0.8 * 1.6e8 * (510.0 / (0.1 * 7450.0)) ** (1.0 / 3.0)
    expected = 1.0 / held_n_per_m + 1.0 / coupling_n_per_m + 1.0 / nut_n_per_m
    plant = plant_of(arranged(machine, arrangement))
    found = axial_compliance(plant, position_m, 100.0 * 510.0 / 7450.0)
    assert found == pytest.approx(expected, rel=1e-12)


def test_stiffness_of_the_bench_falls_modestly_along_the_stroke(machine: Machine) -> None:
    """The thesis on its Figure 5.5: one end to the other changes little, many springs share."""
    curve = series_stiffness(springs_of(machine, spring(6.85)), np.linspace(0.05, 0.85, 17))
    assert np.all(np.diff(curve.stiffness_n_per_m) < 0.0)
    assert 0.5 < curve.stiffness_n_per_m[-1] / curve.stiffness_n_per_m[0] < 0.9


@settings(deadline=None)
@given(
    bearing=st.floats(1e7, 1e9), nut=st.floats(1e7, 1e9), position_m=st.floats(0.0, LENGTH_M / 2.0)
)
def test_two_held_ends_are_symmetric_and_never_softer(
    bearing: float, nut: float, position_m: float
) -> None:
    free = replace(SCREW_ALONE, bearing_n_per_m=spring(bearing), nut_n_per_m=spring(nut))
    both = replace(free, bearing_arrangement="fixed-fixed")
    positions = np.array([position_m, LENGTH_M - position_m])
    held = series_stiffness(both, positions).stiffness_n_per_m
    assert held[0] == pytest.approx(held[1], rel=1e-9)
    assert np.all(held > series_stiffness(free, positions).stiffness_n_per_m)


@pytest.mark.parametrize("arrangement", ["fixed-free", "fixed-fixed"])
def test_sigma_is_the_spread_of_many_draws(arrangement: str) -> None:
    """Independent: each drawn stiffness put together as springs side by side and in a row."""
    ratio, draws = SCREW_ALONE.ratio_m_per_rad, 100_000
    springs = replace(
        SCREW_ALONE,
        coupling_nm_per_rad=spring(3850.0, 0.03),
        bearing_n_per_m=spring(1e8, 0.03),
        nut_n_per_m=spring(1.1e8, 0.02),
        screw_rigidity_n=spring(RIGIDITY_N, 0.02),
        torsional_rigidity_nm2=spring(1240.0, 0.05),
        bearing_arrangement=arrangement,
    )
    random = np.random.default_rng(3)

    def drawn(value: float, tolerance: float) -> np.ndarray:
        return value * (1.0 + tolerance * random.standard_normal(draws))

    a, b = 0.3, LENGTH_M - 0.3
    rigidity, bearing = drawn(RIGIDITY_N, 0.02), drawn(1e8, 0.03)
    held = 1.0 / (1.0 / bearing + a / rigidity)
    if arrangement == "fixed-fixed":
        held = held + 1.0 / (1.0 / bearing + b / rigidity)
    torsion = 1.0 / drawn(3850.0, 0.03) + a / drawn(1240.0, 0.05)
    stiffness = 1.0 / (1.0 / held + 1.0 / drawn(1.1e8, 0.02) + ratio**2 * torsion)
    curve = series_stiffness(springs, np.array([a]))
    assert float(curve.stiffness_n_per_m[0]) == pytest.approx(float(np.mean(stiffness)), rel=1e-3)
    assert float(curve.sigma_n_per_m[0]) == pytest.approx(float(np.std(stiffness)), rel=0.02)
    assert sum(float(share[0]) for share in curve.shares.values()) == pytest.approx(1.0)


def test_twist_of_the_screw_is_that_of_a_coupling_a_third_of_a_metre_away() -> None:
    coupling = 67.2 * 180.0 / math.pi
    assert screw_torsional_rigidity(0.02) / coupling == pytest.approx(0.32, abs=0.01)


@settings(deadline=None)
@given(preload_percent=st.floats(0.6, 20.0), catalogue=st.floats(1e7, 1e9))
def test_preload_comes_back_from_the_stiffness_of_the_nut(
    preload_percent: float, catalogue: float
) -> None:
    stiffness = nut_stiffness(catalogue, preload_percent)
    assert preload_from_nut_stiffness(stiffness, catalogue) == pytest.approx(preload_percent)


def test_soft_nut_says_that_preload_or_less() -> None:
    assert preload_from_nut_stiffness(1e3, 1.6e8) == LEAST_NUT_LOAD_PERCENT


def test_nut_takes_a_third_of_the_tolerance_of_its_preload() -> None:
    random = np.random.default_rng(7)
    percent = 6.8 * (1.0 + 0.03 * random.standard_normal(20_000))
    drawn = [nut_stiffness(1.6e8, value) for value in percent]
    nut = preloaded_nut(spring(1.6e8), spring(6.8, 0.03))
    assert nut.sigma == pytest.approx(float(np.std(drawn)), rel=0.03)


def test_stated_nut_stiffness_holds_at_the_fresh_preload(machine: Machine) -> None:
    model = machine.model.model_copy(update={"nut_stiffness_n_per_m": spring(1.0e8, 0.05)})
    stated = machine.model_copy(update={"model": model})
    percent = machine.fresh_preload_percent
    assert percent is not None
    nut = springs_of(stated, spring(percent)).nut_n_per_m
    assert (nut.value, nut.tolerance) == pytest.approx((1.0e8, 0.05))
    silent = stated.model_copy(update={"model": model.model_copy(update={"preload_n": None})})
    with pytest.raises(ValueError, match=r"^model\.nut_stiffness_n_per_m[^\n]*$"):
        springs_of(silent, spring(percent))


@pytest.mark.parametrize("position_m", [-0.001, LENGTH_M + 0.001, math.nan])
def test_nut_off_the_screw_is_refused(position_m: float) -> None:
    with pytest.raises(ValueError, match=r"^position_m: expected 0 to 0\.998 m[^\n]*$"):
        series_stiffness(SCREW_ALONE, np.array([0.1, position_m]))


def test_impossible_springs_are_refused() -> None:
    with pytest.raises(ValueError, match="at least one spring"):
        in_series([])
    with pytest.raises(ValueError, match=r"^stiffness_n_per_m must"):
        in_series([spring(0.0)])
    with pytest.raises(ValueError, match=r"^nut_n_per_m must"):
        replace(SCREW_ALONE, nut_n_per_m=spring(-1.0))
    with pytest.raises(ValueError, match=r"^torsional_rigidity_nm2 must"):
        replace(SCREW_ALONE, torsional_rigidity_nm2=spring(0.0))
