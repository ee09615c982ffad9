"""An effect that leaves structure which other motion repeats is taken for a misattribution."""

from collections.abc import Callable

import numpy as np
import pytest

from edge_service.diagnose.candidates.regressors import UNKNOWN, null_shapes
from edge_service.diagnose.residual.structure import predicted_structure
from edge_service.diagnose.session.session import TORQUE_GAP, TRANSMISSION_GAP, Rows, Session
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, session_of


@pytest.fixture(scope="module")
def session(machine: Machine) -> Session:
    return session_of(machine, frame_of(recorded((), 3)))


def variable(session: Session, name: str, channel: str = TORQUE_GAP) -> Floats:
    return session.channels[channel].variables[name]


def noise(rows: Rows, rms: float = 1.0) -> Floats:
    return np.random.default_rng(5).normal(0.0, rms, len(rows.gap))


def energy(values: Floats) -> float:
    return float(np.sum(values**2))


@pytest.mark.parametrize(
    "curve",
    [
        lambda s: np.sign(variable(s, "direction")),
        lambda s: np.tanh(variable(s, "motor_speed_rad_s") / 30.0),
        lambda s: np.sin(3.0 * variable(s, "motor_angle_rad")),
        lambda s: np.exp(-(((variable(s, "table_position_m") - 0.4) / 0.15) ** 2)),
    ],
)
def test_structure_is_foretold_on_other_motion(
    session: Session, curve: Callable[[Session], Floats]
) -> None:
    gap = curve(session)
    left = gap + noise(session.channels[TORQUE_GAP], 0.1 * float(np.std(gap)))
    found = predicted_structure(session, {TORQUE_GAP: left})[TORQUE_GAP]
    assert energy(gap - found) < 0.15 * energy(gap)


def test_noise_is_not_foretold(session: Session) -> None:
    left = noise(session.channels[TORQUE_GAP])
    found = predicted_structure(session, {TORQUE_GAP: left})[TORQUE_GAP]
    assert energy(left - found) > 0.98 * energy(left)


def test_nameless_forms_claim_one_channel_each(session: Session) -> None:
    forms = list(null_shapes(session))
    assert {form.name for form in forms} == {UNKNOWN}
    for form in forms:
        shown = [name for name in session.channels if np.any(form.columns(session, name))]
        assert shown == [TORQUE_GAP if form.curves.torque else TRANSMISSION_GAP]
