"""Why an effect is not judged: a channel is blamed only if it would have shown the effect."""

import numpy as np
import pytest

from edge_service.diagnose.candidates.regressors import unobservable
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, SampleFrame
from edge_service.models.machine import Machine

from ..conftest import session_of


@pytest.mark.parametrize(
    ("missing", "blamed", "needs_it", "shows_elsewhere"),
    [
        (TORQUE, "no torque recorded", "inertia_error", "backlash"),
        (TABLE_POSITION, "one encoder only", "backlash", "external_force"),
    ],
)
def test_a_motion_that_shows_nothing_is_not_the_fault_of_a_channel(
    machine: Machine, missing: str, blamed: str, needs_it: str, shows_elsewhere: str
) -> None:
    """One way at one speed shows neither play nor a force that comes and goes."""
    time_s = np.arange(6000) * 1e-3
    noise = np.random.default_rng(1).standard_normal((3, len(time_s)))
    way_m = 0.2 + 0.05 * time_s
    channels = {
        ANGLE: way_m / machine.transmission_ratio_m_per_rad + 5e-6 * noise[0],
        TORQUE: 0.4 + 0.01 * noise[1],
        TABLE_POSITION: way_m + 5e-8 * noise[2],
    }
    del channels[missing]
    reasons = unobservable(session_of(machine, SampleFrame(time_s, channels)))
    assert reasons[needs_it].startswith(blamed)
    assert reasons[shows_elsewhere] == "not visible in this motion"
