"""Loss of preload in a diagnosis, and what the running service says of the same minutes."""

from functools import cache

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE, load_machine
from edge_service.diagnose.pipeline import diagnose_session, learnable
from edge_service.diagnose.preload import (
    PreloadReading,
    asked_by_torque,
    diagnose_beside_loss,
    fresh_screw,
    known_loss,
    with_missing_drag,
)
from edge_service.diagnose.result import Diagnosis, ParameterValue, Verdict, withheld
from edge_service.diagnose.session.session import Session
from edge_service.health.consistency import ConsistencyWatch
from edge_service.messages.health import ConsistencyState
from edge_service.messages.samples import Floats, SampleFrame
from edge_service.models.effects.library.preload_loss import lost_percent
from edge_service.models.effects.registry import effects
from edge_service.models.machine import Machine
from edge_service.nodes.stages import make_downsampler
from tests.nodes.conftest import production

from ..conftest import session_of
from ..test_diagnosis import diagnosed

RATE_HZ, SECONDS = 1000.0, 24
THERE = PreloadReading(99.0, 95.0, 104.0, two_encoders=True)
FRESH = {"fresh_drag_nm": 0.146, "fresh_percent": 6.85, "fresh_nut_m_per_n": 8.9e-9}


@cache
def axis() -> Machine:
    return load_machine(DEFAULT_MACHINE.with_name("commissioned.toml"))


def recorded(lost: Floats) -> Session:
    """Production of an axis that has lost so much of its fresh preload at each second, percent."""
    machine, time_s = axis(), np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    fresh = machine.fresh_preload_percent or 0.0
    percent = fresh * (1.0 - np.interp(time_s, np.arange(len(lost)), lost) / 100.0)
    return session_of(machine, production(machine, percent, len(time_s), seed=5))


@pytest.mark.parametrize(
    ("lost", "ends"),
    [
        (np.full(SECONDS, 60.0), (60.0, 60.0)),
        (np.full(SECONDS, 100.0), (100.0, 100.0)),
        (np.linspace(20.0, 70.0, SECONDS), (20.0, 70.0)),
        (np.linspace(0.0, 0.0, SECONDS), (0.0, 0.0)),
    ],
)
def test_the_course_of_a_loss_is_that_of_the_torque(lost, ends):
    session, fresh = recorded(lost), fresh_screw(axis())
    assert fresh is not None
    course = known_loss(session, fresh)
    found = lost_percent(course.values, np.array([0.5, SECONDS - 0.5]))
    assert found == pytest.approx(ends, abs=4.0)


@pytest.mark.parametrize(("lost", "grows", "asked"), [(0, 0.0, 0), (0, 3e-4, 0), (60, 0.0, 1)])
def test_a_screw_is_accused_only_by_its_torque(lost, grows, asked):
    """Friction that grows with acceleration, N m per rad/s2, is no lost preload."""
    session, fresh = recorded(np.full(SECONDS, lost)), fresh_screw(axis())
    assert fresh is not None
    rows = session.channels["torque_nm"]
    hard = np.abs(rows.variables["motor_acceleration_rad_s2"])
    rows.gap[:] += grows * hard * np.sign(rows.variables["motor_speed_rad_s"])
    course = known_loss(session, fresh)
    assert asked_by_torque(session, axis(), course) == pytest.approx(asked, abs=0.05)


@pytest.mark.slow
def test_a_known_loss_comes_first_and_no_warmth_is_named():
    session, fresh = recorded(np.linspace(90.0, 100.0, SECONDS)), fresh_screw(axis())
    assert fresh is not None
    reading = PreloadReading(2.0, 0.0, 12.0, two_encoders=True)
    found = diagnose_beside_loss(session, axis(), known_loss(session, fresh), reading)
    names = [each.name for each in found.effects]
    assert names[0] == "preload_loss"
    sure = {each.name for each in found.effects if each.probability > 0.9}
    assert sure == {"preload_loss"}
    assert not {"compliance", "warmup", "drag_error"} & set(names)
    lost = found.effects[0].parameters["lost_percent"]
    assert (lost.low, lost.value, lost.high, lost.unit) == (88.0, 98.0, 100.0, "%")
    assert found.gap["torque_nm"].before > 5.0 * found.gap["torque_nm"].after
    assert found.effects[0].shrink.low > 0.5
    assert found.effects[0].replay.estimate > 0.5
    assert withheld(found) == ("preload_loss",)
    assert "preload_loss" not in [each.name for each in learnable(found, session)]


def watched(watch: ConsistencyWatch, rows: int, *there: str) -> SampleFrame:
    """Production with some effects that a watch has seen as well."""
    frame = production(axis(), axis().fresh_preload_percent or 0.0, rows, *there, seed=rows)
    for block in make_downsampler(axis()).push(frame):
        watch.add(block)
    return frame


SLOW = [pytest.param([name], marks=pytest.mark.slow) for name in effects()]


@pytest.mark.parametrize("there", [[], ["load_offset"], *SLOW])
def test_what_the_service_disagrees_with_is_a_gap(there):
    watch = ConsistencyWatch(axis().transmission_ratio_m_per_rad)
    watched(watch, 300_000)
    found = diagnose_session(session_of(axis(), watched(watch, 60_000, *there)), axis())
    disagrees = watch.shown().state is ConsistencyState.DISAGREES
    assert not disagrees or found.verdict is not Verdict.NO_GAP
    if not there:
        assert (found.verdict, found.effects, disagrees) == (Verdict.NO_GAP, (), False)


@pytest.mark.parametrize(
    ("reading", "is_lost", "is_there"),
    [
        (PreloadReading(50.0, 40.0, 60.0, two_encoders=True), True, False),
        (PreloadReading(50.0, 40.0, 60.0, two_encoders=False), False, False),
        (PreloadReading(90.0, 80.0, 101.0, two_encoders=True), False, False),
        (THERE, False, True),
        (PreloadReading(99.0, 95.0, 104.0, two_encoders=False), False, False),
    ],
)
def test_one_encoder_is_never_sure_of_the_preload(reading, is_lost, is_there):
    assert (reading.is_lost, reading.is_there) == (is_lost, is_there)
    assert 0.0 <= reading.lost.low <= reading.lost.value <= reading.lost.high <= 100.0


def drag_changed(machine: Machine, change_nm: float) -> Diagnosis:
    """A diagnosis that names another Coulomb level."""
    found, _ = diagnosed(machine, ("drag_error",), seed=3)
    (drag,) = found.effects
    ends = change_nm - 0.01, change_nm + 0.01
    change = ParameterValue(value=change_nm, low=ends[0], high=ends[1], unit="N m")
    changed = drag.model_copy(update={"parameters": {"change_nm": change}})
    return found.model_copy(update={"effects": (changed,)})


@pytest.mark.slow
def test_less_drag_is_tied_with_lost_preload_and_neither_is_learned(machine: Machine):
    before = drag_changed(machine, -0.073)
    found = with_missing_drag(before, FRESH, None)
    assert [each.name for each in found.effects] == ["preload_loss", "drag_error"]
    assert all({"preload_loss", "drag_error"} == set(each.tied) for each in found.effects)
    assert found.effects[1].probability == before.effects[0].probability
    assert found.effects[0].parameters["lost_percent"].value == pytest.approx(50.0)
    assert found.verdict is Verdict.AMBIGUOUS
    assert learnable(found, diagnosed(machine, ("drag_error",), seed=3)[1]) == ()


@pytest.mark.parametrize(("change_nm", "reading"), [(0.05, None), (-0.4, None), (-0.073, THERE)])
def test_what_no_loss_of_preload_does_is_none(machine: Machine, change_nm, reading):
    """More friction; less by more than the screw has; less, while the preload is there."""
    found = drag_changed(machine, change_nm)
    assert with_missing_drag(found, FRESH, reading) is found


def test_without_a_fresh_preload_only_a_sentence_is_added(machine: Machine):
    found = drag_changed(machine, -0.073)
    told = with_missing_drag(found, None, None)
    assert (told.verdict, told.effects, told.gap) == (found.verdict, found.effects, found.gap)
    assert "model.preload_n" in told.caveats[-1]
