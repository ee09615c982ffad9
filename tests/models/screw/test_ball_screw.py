import math

import pytest

from edge_service.models.machine import Machine
from edge_service.models.screw.ball_screw import (
    ball_pass_orders,
    lead_angle,
    table_inertia,
    transmission_ratio,
)

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
