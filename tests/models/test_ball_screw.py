import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.models.machine import Machine
from edge_service.models.screw.ball_screw import (
    ball_pass_orders,
    drag_torque,
    lead_angle,
    lumped_inertia,
    preload_from_drag,
    preload_tolerance,
    screw_inertia,
    table_inertia,
    transmission_ratio,
)

LEAD_M = 0.02
STEEL_KG_M3 = 8050.0  # Table 4.1
LEAD_ANGLE_RAD = math.radians(17.17)  # Table A.1
KGF_CM_NM = 9.80665e-2


def test_inertias_are_those_of_table_4_1() -> None:
    screw = screw_inertia(STEEL_KG_M3, 1.0, 0.02)
    table = table_inertia(10.0 + 10.0, LEAD_M)
    assert screw == pytest.approx(1.26e-4, rel=0.005)
    assert table == pytest.approx(2e-4, rel=0.02)
    assert lumped_inertia(3e-3, screw, table) == pytest.approx(3.3e-3, rel=0.01)


def test_printed_table_inertia_would_be_six_times_that_of_table_4_1() -> None:
    printed = 20.0 * LEAD_M**2 / (2.0 * math.pi)
    assert printed / table_inertia(20.0, LEAD_M) == pytest.approx(2.0 * math.pi)


def test_printed_transmission_ratio_is_half_of_its_own_equation() -> None:
    assert transmission_ratio(LEAD_M) == pytest.approx(2.0 * 1.59e-3, rel=0.002)


def test_bench_inertia_is_the_sum_of_appendix_a(machine: Machine) -> None:
    """Rotor (A.4), coupling (A.5), screw (A.1) and the table of Table 4.1 against 1.5e-3."""
    total = lumped_inertia(
        motor_kg_m2=10.4e-4,
        screw_kg_m2=screw_inertia(STEEL_KG_M3, 0.998, 0.02),
        table_kg_m2=table_inertia(20.0, LEAD_M),
        coupling_kg_m2=9.95e-5,
    )
    assert total == pytest.approx(1.468e-3, rel=1e-3)
    assert machine.model.inertia_kg_m2.value == pytest.approx(total, rel=0.025)


def test_lead_angle_of_the_bench_belongs_to_a_ball_circle_above_the_nominal_diameter() -> None:
    assert lead_angle(LEAD_M, LEAD_M / math.pi) == pytest.approx(math.pi / 4.0)
    assert lead_angle(LEAD_M, 0.02) > LEAD_ANGLE_RAD > lead_angle(LEAD_M, 0.0215)


def test_bench_drag_torque_is_within_table_a_1_read_in_kgf_cm(machine: Machine) -> None:
    without, with_loss = (drag_torque(510.0, LEAD_M, LEAD_ANGLE_RAD, eta) for eta in (1.0, 0.9))
    assert without == pytest.approx(0.146, abs=5e-4)
    assert with_loss == pytest.approx(0.146 / 0.9, abs=5e-4)
    for drag_nm in (without, with_loss):
        assert 1.18 * KGF_CM_NM < drag_nm < 1.77 * KGF_CM_NM
    assert machine.model.preload_drag_nm is not None
    assert machine.model.preload_drag_nm.value == pytest.approx(without, abs=5e-4)


def test_drag_of_a_kilonewton_is_about_that_of_table_4_1() -> None:
    assert drag_torque(1000.0, LEAD_M, 0.31, 0.9) == pytest.approx(0.3, rel=0.05)


@settings(deadline=None)
@given(
    preload_n=st.floats(0.0, 1e5),
    lead_m=st.floats(1e-3, 0.1),
    angle_rad=st.floats(0.01, 1.5),
    efficiency=st.floats(0.1, 1.0),
)
def test_preload_from_drag_undoes_drag_torque(
    preload_n: float, lead_m: float, angle_rad: float, efficiency: float
) -> None:
    drag_nm = drag_torque(preload_n, lead_m, angle_rad, efficiency)
    assert preload_from_drag(drag_nm, lead_m, angle_rad, efficiency) == pytest.approx(preload_n)


def test_arrays_keep_their_shape_and_missing_stays_missing() -> None:
    drag_nm = np.array([[0.146, math.nan], [0.0, -0.073]])
    preload_n = preload_from_drag(drag_nm, LEAD_M, LEAD_ANGLE_RAD, 1.0)
    assert preload_n.shape == (2, 2)
    assert np.isnan(preload_n).tolist() == [[False, True], [False, False]]
    assert preload_n[1, 1] == pytest.approx(-0.5 * preload_n[0, 0])


def test_preload_tolerance_is_the_spread_of_many_draws() -> None:
    random = np.random.default_rng(5)
    drag_nm = 0.146 * (1.0 + 0.02 * random.standard_normal(200_000))
    share = 1.0 + 0.03 * random.standard_normal(200_000)
    preload_n = share * preload_from_drag(drag_nm, LEAD_M, LEAD_ANGLE_RAD, 0.9)
    spread = float(np.std(preload_n) / np.mean(preload_n))
    assert preload_tolerance(0.02, 0.03) == pytest.approx(spread, rel=0.01)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: transmission_ratio(0.0), "lead_m"),
        (lambda: transmission_ratio(math.nan), "lead_m"),
        (lambda: lead_angle(0.02, -0.02), "ball_circle_m"),
        (lambda: screw_inertia(8050.0, 1.0, 0.0), "diameter_m"),
        (lambda: table_inertia(-1.0, 0.02), "mass_kg"),
        (lambda: lumped_inertia(-1e-3, 1e-4, 1e-4), "motor_kg_m2"),
        (lambda: drag_torque(510.0, 0.02, 0.0, 0.9), "lead_angle_rad"),
        (lambda: drag_torque(510.0, 0.02, 17.17, 0.9), "lead_angle_rad"),
        (lambda: preload_from_drag(0.1, 0.02, 0.3, 90.0), "efficiency"),
        (lambda: preload_tolerance(-0.1, 0.1), "drag_tolerance"),
    ],
)
def test_impossible_constants_are_named_in_one_line(call: Callable[[], float], word: str) -> None:
    with pytest.raises(ValueError, match=f"^{word} must [^\n]*$"):
        call()


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


@pytest.mark.parametrize(
    ("ball_m", "angle", "told"),
    [(0.03, 0.7, "does not fit"), (3e-3, 1.6, "contact_angle_rad"), (-1.0, 0.7, "ball_diameter_m")],
)
def test_impossible_balls_are_refused(ball_m: float, angle: float, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        ball_pass_orders(ball_m, 0.0206, 0.02, angle)


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
