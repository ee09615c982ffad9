"""Springs between the encoders carry what the table does, not what the motor does."""

from pathlib import Path

import numpy as np

from edge_service.config import load_machine
from edge_service.diagnose.session.session import TRANSMISSION_GAP, Session, rms
from edge_service.messages.samples import ANGLE, TABLE_POSITION, SampleFrame
from edge_service.models.effects.registry import active_effect
from edge_service.models.machine import Quantity

from ..conftest import session_of


def test_a_table_that_shakes_by_its_spring_has_no_gap_and_a_heavier_one_winds_it_up_once():
    """Near its resonance x = R theta / (1 - r^2) at a frequency ratio r: no motor moves so far."""
    machine = load_machine(Path(__file__).parents[3] / "deploy" / "commissioned.toml")
    time_s, ratio, known = np.arange(0.0, 5.0, 1e-3), 0.4, machine.commissioned
    soft = known.transmission.model_copy(update={"stretch_per_acceleration_s2": 2e-5})
    smooth = machine.model.model_copy(update={"guide_force_n": Quantity(value=0.0)})
    known = known.model_copy(update={"transmission": soft})
    machine = machine.model_copy(update={"commissioned": known, "model": smooth})
    motor_m = 1e-4 * np.sin(ratio * 2e-5**-0.5 * time_s)
    moved_m = motor_m / (1.0 - ratio**2)
    angle = (soft.reference_m + motor_m) / machine.transmission_ratio_m_per_rad
    frame = SampleFrame(time_s, {ANGLE: angle, TABLE_POSITION: soft.reference_m + moved_m})
    session = session_of(machine, frame)
    gap, heavier = session.channels[TRANSMISSION_GAP].gap, {"change_kg_m2": 1e-4}
    assert rms(gap) < 0.03 * rms(moved_m - motor_m)
    modelled = (*session.modelled, active := active_effect("inertia_error", heavier))
    learned = Session.of_runs(session.runs, session.baseline, modelled)
    wound_m = session.signature(TRANSMISSION_GAP, active.effect, heavier)
    left_m = learned.channels[TRANSMISSION_GAP].gap - (gap - wound_m)
    assert rms(left_m) < 1e-6 * rms(wound_m)
