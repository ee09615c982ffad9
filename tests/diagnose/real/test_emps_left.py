"""Remainder of a real axis once its published friction is in the model (EMPS, 2019)."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import load_machine
from edge_service.diagnose.session.session import TORQUE_GAP, Session
from edge_service.models.machine import EffectConfig, Quantity
from edge_service.offline.diagnosis.sessions import read_runs, session_of

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data" / "emps"
RATIO = 0.0025 / (2.0 * np.pi)
COULOMB_N, OFFSET_N = 20.3935, -3.1648
PUBLISHED_RESIDUAL_N = {"emps_estimation.csv": 2.1843, "emps_validation_pulses.csv": 3.4039}
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the EMPS recordings are not here")


@cache
def session_of_record(name: str) -> Session:
    """Remainder of a record beside the published friction."""
    effects = [
        EffectConfig(
            name="drag_error", parameters={"change_nm": Quantity(value=COULOMB_N * RATIO)}
        ),
        EffectConfig(
            name="load_offset", parameters={"constant_nm": Quantity(value=OFFSET_N * RATIO)}
        ),
    ]
    machine = load_machine(ROOT / "deploy" / "emps.toml").model_copy(update={"effects": effects})
    return session_of(machine, read_runs(machine, [DATA / name]))


@pytest.mark.parametrize("name", PUBLISHED_RESIDUAL_N)
def test_the_published_friction_leaves_the_published_residual_and_a_small_ripple(name):
    session = session_of_record(name)
    rows = session.channels[TORQUE_GAP]
    assert rows.rms / RATIO == pytest.approx(PUBLISHED_RESIDUAL_N[name], rel=0.12)
    columns = np.column_stack(
        [
            session.column(
                TORQUE_GAP, lambda motion, order=order, turn=turn: turn(order * motion.angle_rad)
            )
            for order in (1, 2)
            for turn in (np.sin, np.cos)
        ]
    )
    left = rows.gap - columns @ np.linalg.lstsq(columns, rows.gap, rcond=None)[0]
    shrink = 1.0 - float(np.sqrt(np.mean(left**2))) / rows.rms
    assert 0.002 < shrink < 0.06
