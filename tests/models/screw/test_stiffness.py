"""Ball screw: its stiffness, geometry, friction and wear."""

import math

import numpy as np
import pytest

from drivers.simulated import SCENARIOS, Wear
from edge_service.models.machine import Machine
from edge_service.models.plant.from_machine import plant_of
from edge_service.models.plant.two_mass import Plant, axial_compliance
from edge_service.models.screw.ball_screw import (
    ball_pass_orders,
    lead_angle,
    table_inertia,
    transmission_ratio,
)
from edge_service.models.screw.friction import exponential_friction
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


LEAD_M = 0.02
LEAD_ANGLE_RAD = math.radians(17.17)  # Table A.1


def test_printed_table_inertia_would_be_six_times_that_of_table_4_1() -> None:
    printed = 20.0 * LEAD_M**2 / (2.0 * math.pi)
    assert printed / table_inertia(20.0, LEAD_M) == pytest.approx(2.0 * math.pi)


def test_printed_transmission_ratio_is_half_of_its_own_equation() -> None:
    assert transmission_ratio(LEAD_M) == pytest.approx(2.0 * 1.59e-3, rel=0.002)


def test_lead_angle_of_the_bench_belongs_to_a_ball_circle_above_the_nominal_diameter() -> None:
    assert lead_angle(LEAD_M, LEAD_M / math.pi) == pytest.approx(math.pi / 4.0)
    assert lead_angle(LEAD_M, 0.02) > LEAD_ANGLE_RAD > lead_angle(LEAD_M, 0.0215)


def test_balls_roll_between_a_screw_that_turns_and_a_nut_that_does_not() -> None:
    """By rolling: contact points of the tracks move at omega r; a ball's centre at the mean."""
    ball_m, circle_m, lead_m, angle = 3.175e-3, 0.0206, 1e-9, math.radians(40.0)  # no climb
    inner_m = 0.5 * (circle_m - ball_m * math.cos(angle))
    centre_rad_s = 0.5 * 1.0 * inner_m / (0.5 * circle_m)
    orders = ball_pass_orders(ball_m, circle_m, lead_m, angle, balls_per_turn=18.0)
    assert orders.on_nut == pytest.approx(18.0 * centre_rad_s)
    assert orders.on_screw == pytest.approx(18.0 * (1.0 - centre_rad_s))
    share = ball_m * math.cos(angle) / circle_m
    assert orders.spin == pytest.approx(circle_m / (2.0 * ball_m) * (1.0 - share**2))


def test_the_balls_of_a_turn_are_those_that_fit_along_the_helix() -> None:
    ball_m, circle_m, lead_m = 3.175e-3, 0.0206, 0.02
    turn_m = math.hypot(math.pi * circle_m, lead_m)
    orders = ball_pass_orders(ball_m, circle_m, lead_m, 0.0)
    assert orders.on_nut + orders.on_screw == pytest.approx(turn_m / ball_m)


def test_a_machine_file_knows_its_balls_or_says_nothing(machine: Machine) -> None:
    assert machine.ball_pass_orders is None
    axis = {"lead_m": 0.02, "ball_diameter_m": 3.175e-3, "ball_circle_m": 0.0206}
    model = {"inertia_kg_m2": 1.5e-3}
    known = Machine.model_validate({"axis": axis, "model": model})
    assert known.ball_pass_orders == ball_pass_orders(3.175e-3, 0.0206, 0.02, math.pi / 4.0)
    for wrong in ({"ball_circle_m": 3e-3}, {"ball_diameter_m": 0.03}):
        with pytest.raises(ValueError, match="must be less than ball_circle_m"):
            Machine.model_validate({"axis": axis | wrong, "model": model})
    with pytest.raises(ValueError, match="balls_per_turn needs"):
        Machine.model_validate({"axis": {"lead_m": 0.02, "balls_per_turn": 18}, "model": model})


def test_inertia_of_the_bench_is_the_sum_of_appendix_a(machine: Machine) -> None:
    """Rotor (A.4), coupling (A.5), screw (A.1) and the table of Table 4.1 against 1.5e-3."""
    screw_kg_m2 = 8050.0 * 0.998 * math.pi * 0.02**4 / 32.0
    total = 10.4e-4 + screw_kg_m2 + table_inertia(20.0, LEAD_M) + 9.95e-5
    assert total == pytest.approx(1.468e-3, rel=1e-3)
    assert machine.model.inertia_kg_m2.value == pytest.approx(total, rel=0.025)


def test_exponential_form_jumps_at_rest_and_falls_to_the_coulomb_level() -> None:
    def level(share: float) -> float:
        return float(exponential_friction(share * 0.01, 60.0, 90.0, 0.01))

    assert (level(1e-9), level(0.0), level(-1e-9)) == pytest.approx((90.0, 0.0, -90.0))
    assert level(1.0) == pytest.approx(60.0 + 30.0 / math.e)
    assert level(-2.0) == pytest.approx(-60.0 - 30.0 / math.e**4)
    assert exponential_friction(-0.5, 60.0, 90.0, 0.01, 200.0) == pytest.approx(-160.0)


LIFE_S = 3600.0


def at(wear: Wear, *ages: float) -> list[float]:
    return [float(p) for p in wear.preload_percent(np.array(ages) * LIFE_S, LIFE_S)]


def test_gradual_loss_is_a_straight_line_between_two_holds() -> None:
    ages = (-1.0, 0.0, 0.05, 0.25, 0.5, 1.0, 3.0)
    assert at(SCENARIOS["gradual"], *ages) == pytest.approx([10, 10, 9.5, 7.5, 5, 0, 0])


def test_partial_loss_starts_and_ends_elsewhere() -> None:
    assert at(SCENARIOS["partial"], 0.0, 0.5, 1.0) == pytest.approx([7.5, 5.0, 2.5])


def test_sudden_loss_comes_whole_at_half_of_the_life() -> None:
    before = np.nextafter(0.5, 0.0)
    assert at(SCENARIOS["sudden"], 0.0, before, 0.5, 1.0) == [10.0, 10.0, 0.0, 0.0]
