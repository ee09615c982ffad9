"""Springs between the encoders carry what the table does, not what the motor does."""

from pathlib import Path

import numpy as np

from edge_service.config import load_machine
from edge_service.diagnose.session.session import rms
from edge_service.messages.samples import ANGLE, TABLE_POSITION, SampleFrame
from edge_service.models.machine import Quantity

from ..conftest import session_of


def test_a_table_that_shakes_by_its_spring_has_no_gap():
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
    (gap,) = session_of(machine, frame).channels.values()
    assert gap.rms < 0.03 * rms(moved_m - motor_m)
