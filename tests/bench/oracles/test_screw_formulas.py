import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.models.machine import Machine
from edge_service.models.screw.ball_screw import table_inertia

from .screw_formulas import (
    drag_torque,
    lumped_inertia,
    preload_from_drag,
    preload_tolerance,
    screw_inertia,
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
        (lambda: screw_inertia(8050.0, 1.0, 0.0), "diameter_m"),
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
