"""A led axis makes what a controlled one makes, and says when it cannot."""

from dataclasses import replace

import numpy as np
import pytest

from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.session.prescribed_motion import PrescribedMotionAxis
from edge_service.diagnose.session.recordings import runs_of
from edge_service.diagnose.session.session import (
    TORQUE_GAP,
    TRANSMISSION_GAP,
    Session,
    rigid_baseline,
    rigid_plant,
)
from edge_service.messages.samples import ANGLE, TABLE_POSITION, TORQUE, Floats, SampleFrame
from edge_service.models.effects.effect import ActiveEffect
from edge_service.models.effects.registry import active_effect, effects, get_effect
from edge_service.models.feed_drive import FeedDrive, FeedDriveSettings
from edge_service.models.machine import Machine
from edge_service.models.plant.closed_loop import Sensors

from ..conftest import frame_of, recorded, session_of
from ..test_diagnosis import diagnosed

QUIET = Sensors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
RATE_HZ = 1000.0
BRISTLES = active_effect("presliding", {"reach_m": 2e-5})
"""True sticking makes a controlled axis jerk at reversals; how is nobody's to foresee."""
HELD = active_effect("delay", {"lag_s": 0.5 / RATE_HZ})
"""A command that is held for a period acts half a period late."""
NOT_REPLAYED = {"saturation", "preload_loss"}
"""A controller decides itself how far it asks beyond the limit; a loss of preload needs a machine
file that knows it: `tests/diagnose/preload` replays that."""
BETWEEN = {"backlash", "compliance", "lead_error", "thermal_growth", "timestamp_skew"}
BETWEEN |= {"encoder_eccentricity"}
REPLAYED = {
    name: TRANSMISSION_GAP if name in BETWEEN else TORQUE_GAP
    for name in sorted(effects().keys() - NOT_REPLAYED)
}


def to_and_fro(duration_s: float = 8.0) -> Floats:
    """Setpoints (n, 3) over half a metre, with some speeds and reversals."""
    time_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    position = 0.3 - 0.2 * np.cos(1.1 * time_s) - 0.05 * np.cos(3.7 * time_s)
    speed = np.gradient(position, 1.0 / RATE_HZ)
    return np.column_stack((position, speed, np.gradient(speed, 1.0 / RATE_HZ)))


def controlled(machine: Machine, effects_there: list[ActiveEffect]) -> Session:
    """A noiseless recording of the stiff axis under its cascade."""
    settings = FeedDriveSettings.of_machine(machine, RATE_HZ, [BRISTLES, *effects_there])
    settings = replace(settings, plant=rigid_plant(settings.plant), sensors=QUIET)
    setpoints = to_and_fro()
    drive = FeedDrive(settings, float(setpoints[0, 0]), 7.0, 1)
    frame = drive.advance(setpoints, np.full(len(setpoints), 7.0))
    kept = {name: frame.channels[name] for name in (ANGLE, TORQUE, TABLE_POSITION)}
    baseline = rigid_baseline(machine)
    made = runs_of([SampleFrame(frame.time_s, kept)], baseline)
    return Session.of_runs(made, baseline)


def left(machine: Machine, session: Session, effects_there: list[ActiveEffect], name: str) -> float:
    """Root mean square of controlled less led, after the first second."""
    axis = PrescribedMotionAxis.of_machine(machine, session.baseline)
    variant = [axis.with_effects([BRISTLES, HELD, *effects_there])]
    led = [
        axis.simulated(run, variant, np.zeros(len(run.motion), dtype=np.int64))
        for run in session.runs
    ]
    simulated = Session.of_runs(led, session.baseline).channels[name]
    late = simulated.variables["time_s"] > 1.0
    return float(np.sqrt(np.mean((session.channels[name].gap - simulated.gap)[late] ** 2)))


def test_without_effects_the_torque_is_that_of_the_model(machine: Machine) -> None:
    session = controlled(machine, [])
    assert left(machine, session, [], TORQUE_GAP) < 1e-3
    axis = PrescribedMotionAxis.of_machine(machine, session.baseline)
    run = session.runs[0]
    led = axis.simulated(run, [axis.with_effects([])], np.zeros(len(run.motion), dtype=np.int64))
    moving = np.abs(run.motion.speed_rad_s) > 2.0
    off = (led.motion.torque_nm - run.motion.model_torque_nm)[moving][5:-5]
    assert float(np.abs(off).max()) < 1e-3  # J a + D v + F sign(v), by the library's own formula


@pytest.mark.parametrize(("name", "channel"), REPLAYED.items())
def test_the_true_effect_takes_the_gap_away(machine: Machine, name: str, channel: str) -> None:
    given = {"start_s": 3.0, "duration_s": 3.0} if name == "external_force" else {}
    there = [active_effect(name, given)]
    session = controlled(machine, there)
    without, with_it = (left(machine, session, each, channel) for each in ([], there))
    assert with_it < 0.1 * without


def test_regression_and_replay_agree_on_a_foreign_axis(machine: Machine) -> None:
    found, _ = diagnosed(machine, ("torque_ripple",), seed=3)
    (named,) = found.effects
    assert found.replay.possible
    assert named.replay.estimate == pytest.approx(named.shrink.estimate, abs=0.03)
    gap = found.gap[TORQUE_GAP]
    assert gap.replayed.before == pytest.approx(gap.before, rel=0.05)
    beyond = max(gap.replayed.after**2 - gap.floor**2, 0.0)
    assert gap.replayed.unexplained**2 == pytest.approx(beyond)


def test_one_encoder_is_enough(machine: Machine) -> None:
    frame = frame_of(recorded(("drag_error",), 3), table_position_m=None)
    library = [get_effect("drag_error")]
    found = diagnose_session(session_of(machine, frame), machine, library)
    assert set(found.gap) == {TORQUE_GAP}
    assert found.effects[0].replay.estimate > 0.8
