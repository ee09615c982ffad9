import math

import pytest

from edge_service.models.machine import Machine
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import Plant, axial_compliance
from edge_service.models.screw.nut_law import (
    LEAST_NUT_LOAD_PERCENT,
    catalogue_nut_stiffness,
    nut_stiffness,
)
from edge_service.models.screw.stiffness import screw_area, screw_compliance

LENGTH_M, RIGIDITY_N = 0.998, 6.4e7


def test_fixed_free_screw_is_a_rod_of_the_distance_to_the_bearing() -> None:
    assert screw_compliance(0.4, RIGIDITY_N, LENGTH_M, 0.0) == pytest.approx(0.4 / RIGIDITY_N)
    assert screw_compliance(0.0, RIGIDITY_N, LENGTH_M, 0.0) == 0.0


def test_fixed_fixed_screw_is_two_rods_side_by_side() -> None:
    a, b = 0.3, LENGTH_M - 0.3
    both_n_per_m = RIGIDITY_N / a + RIGIDITY_N / b
    assert screw_compliance(a, RIGIDITY_N, LENGTH_M, 1.0) == pytest.approx(1.0 / both_n_per_m)
    softest = screw_compliance(0.5 * LENGTH_M, RIGIDITY_N, LENGTH_M, 1.0)
    assert softest == pytest.approx(0.25 * LENGTH_M / RIGIDITY_N)


def test_nut_stiffness_follows_the_cube_root_of_the_preload() -> None:
    assert nut_stiffness(1.6e8, 10.0) == pytest.approx(0.8 * 1.6e8)
    assert nut_stiffness(1.6e8, 10.0 / 8.0) == pytest.approx(0.4 * 1.6e8)


def test_nut_without_preload_keeps_the_stiffness_of_its_own_load() -> None:
    assert nut_stiffness(1.6e8, 0.0) == nut_stiffness(1.6e8, LEAST_NUT_LOAD_PERCENT) > 0.0


def test_catalogue_stiffness_gives_the_known_stiffness_back() -> None:
    assert nut_stiffness(catalogue_nut_stiffness(1.1e8, 6.8), 6.8) == pytest.approx(1.1e8)


def test_springs_are_in_series(plant: Plant) -> None:
    springs_n_per_m = (
        2.06e11 * math.pi * 0.02**2 / 4.0 / 0.4,
        0.8 * 1.6e8 * 0.5 ** (1.0 / 3.0),
        1.0e8,
        67.2 * 180.0 / math.pi / (0.02 / (2.0 * math.pi)) ** 2,
    )
    expected = sum(1.0 / k for k in springs_n_per_m)
    assert axial_compliance(plant, 0.4, 5.0) == pytest.approx(expected, rel=1e-12)


def test_screw_area_is_a_circle() -> None:
    assert screw_area(0.02) == pytest.approx(3.14159265e-4)


@pytest.mark.parametrize(("arrangement", "ends"), [("fixed-free", 1), ("fixed-fixed", 2)])
@pytest.mark.parametrize("position_m", [0.0, 0.16, 0.499, 0.7, LENGTH_M])
def test_plant_by_hand(machine: Machine, arrangement: str, ends: int, position_m: float) -> None:
    """(5.3.2) with the arms of (5.3.9) and (5.3.10) behind bearings of 1e8 N/m; Table A.5."""
    axis = machine.axis.model_copy(update={"bearing_arrangement": arrangement})
    plant = plant_of(machine.model_copy(update={"axis": axis}))
    arms_m = (position_m, LENGTH_M - position_m)[:ends]
    rigidity_n = 2.06e11 * math.pi * 0.02**2 / 4.0
    held_n_per_m = sum(1.0 / (1.0 / 1e8 + arm_m / rigidity_n) for arm_m in arms_m)
    coupling_n_per_m = 67.2 * 180.0 / math.pi / (0.02 / (2.0 * math.pi)) ** 2
    nut_n_per_m = 0.8 * 1.6e8 * (510.0 / (0.1 * 7450.0)) ** (1.0 / 3.0)
    expected = 1.0 / held_n_per_m + 1.0 / coupling_n_per_m + 1.0 / nut_n_per_m
    found = axial_compliance(plant, position_m, 100.0 * 510.0 / 7450.0)
    assert found == pytest.approx(expected, rel=1e-12)
