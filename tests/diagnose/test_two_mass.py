"""Causes are named on a second plant that shares no code with the library or with the first."""

import math

import pytest

from edge_service.config import load_machine
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import VIBRATION, Diagnosis, Verdict
from edge_service.messages.samples import SampleFrame
from edge_service.models.machine import Machine

from .conftest import session_of
from .two_mass import MACHINE_TOML, Axis, recording

FAULTS = {
    "compliance": Axis(stiffness_n_per_m=3.5e7),
    "position_friction": Axis(rough_nm=0.12),
    "delay": Axis(delay_loops=8),
    "backlash": Axis(play_m=8e-6),
}
TRUE = {"compliance": {"level_m_per_n": 1.0 / 3.5e7}, "backlash": {"width_m": 8e-6}}


@pytest.fixture(scope="module")
def machine_of_plant(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    path = tmp_path_factory.mktemp("two_mass") / "machine.toml"
    path.write_text(MACHINE_TOML)
    return load_machine(path)


def diagnosed(machine: Machine, axis: Axis, seed: int) -> Diagnosis:
    columns = recording(axis, seed)
    frame = SampleFrame(columns.pop("time_s"), columns)
    return diagnose_session(session_of(machine, frame), machine)


@pytest.mark.slow
def test_nothing_is_wrong_with_a_healthy_axis(machine_of_plant: Machine) -> None:
    found = diagnosed(machine_of_plant, Axis(), seed=1)
    assert found.verdict is Verdict.NO_GAP
    assert found.effects == ()


@pytest.mark.slow
@pytest.mark.parametrize("cause", FAULTS)
def test_the_cause_is_named(machine_of_plant: Machine, cause: str) -> None:
    found = diagnosed(machine_of_plant, FAULTS[cause], seed=2)
    assert found.verdict is Verdict.EXPLAINED
    assert [each.name for each in found.effects] == [cause]
    for parameter, true in TRUE.get(cause, {}).items():
        interval = found.effects[0].parameters[parameter]
        assert interval.low < true < interval.high


@pytest.mark.slow
def test_a_force_that_hums_is_a_vibration(machine_of_plant: Machine) -> None:
    found = diagnosed(machine_of_plant, Axis(hum_n=60.0), seed=3)
    assert found.effects[0].name == VIBRATION
    assert all(each.probability < 0.5 for each in found.effects[1:])
    true_hz = Axis().hum_rad_s / (2.0 * math.pi)
    assert found.effects[0].parameters["frequency_hz"].value == pytest.approx(true_hz, rel=0.01)
