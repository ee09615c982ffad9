"""The foreign plant is what it claims to be: alien to the library, physical, repeatable."""

import ast
import sys
from pathlib import Path

import numpy as np
import pytest

from . import foreign_plant as plant
from .foreign_plant.ageing import preload_trajectory
from .foreign_plant.kernel import lugre, nut_deflection
from .foreign_plant.simulate import Recording, planned

FOLDER = Path(__file__).parent / "foreign_plant"
QUIET = {
    "linear_noise_m": 0.0,
    "rotary_noise_rad": 0.0,
    "torque_noise_nm": 0.0,
    "linear_quantum_m": 0.0,
    "rotary_quantum_rad": 0.0,
}


def test_it_shares_no_code_with_the_library() -> None:
    allowed = {"numpy", "scipy", "numba"} | sys.stdlib_module_names
    files = sorted(FOLDER.glob("*.py"))
    assert len(files) > 8
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                assert {each.name.split(".")[0] for each in node.names} <= allowed, file.name
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                assert str(node.module).split(".")[0] in allowed, file.name
            else:
                assert not (isinstance(node, ast.ImportFrom) and node.level > 1), file.name
        assert "importlib" not in file.read_text()
        assert "__import__" not in file.read_text()


# --- physics ---------------------------------------------------------------------------------


@pytest.mark.parametrize("v", [-0.3, 0.002, 0.02, 5.0])
def test_friction_settles_at_the_stribeck_curve(v: float) -> None:
    level, more, vs, reach = 0.7, 0.4, 0.02, 1e-4
    bristle = force = 0.0
    for _ in range(200_000):
        bristle, force = lugre(bristle, v, level, more, vs, reach, 0.01, 25e-6)
        if abs(v) * 25e-6 > reach:
            break
    for _ in range(1000):
        bristle, force = lugre(bristle, v, level, more, vs, reach, 0.01, 25e-6)
    assert force == pytest.approx(np.sign(v) * level * (1 + more * np.exp(-abs(v) / vs)), rel=1e-6)


@pytest.mark.parametrize("percent", [10.0, 6.8456, 2.5])
def test_the_nut_has_the_stiffness_of_the_thesis(percent: float) -> None:
    """(5.3.11): 0.8 K (F_p / 0.1 C_a)^(1/3) for a load much smaller than the preload."""
    machine = plant.Machine()
    preload, hertz = percent / 100 * machine.dynamic_load_rating_n, machine.hertz_n_per_m15
    half = (preload / hertz) ** (2 / 3)
    expected = (
        0.8
        * machine.nut_rigidity_n_per_m
        * (preload / (0.1 * machine.dynamic_load_rating_n)) ** (1 / 3)
    )
    deflection = 0.02 * half
    series = 1e-9
    guess = 0.0
    for _ in range(6):
        guess, force, _ = nut_deflection(
            deflection + series * expected * deflection, guess, series, hertz, half
        )
    assert force / guess == pytest.approx(expected, rel=1e-3)


def test_a_nut_without_preload_has_free_play() -> None:
    hertz, clearance = plant.Machine().hertz_n_per_m15, 1.6e-6
    forces = []
    for stretch in (-1.2e-6, -0.7e-6, 0.7e-6, 1.2e-6):
        guess = 0.0
        for _ in range(20):
            guess, force, _ = nut_deflection(stretch, guess, 1e-8, hertz, -0.5 * clearance)
        forces.append(force)
    assert forces[0] < 0.0 < forces[3]
    assert forces[1:3] == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("machine", [plant.Machine(), plant.DIAGNOSIS], ids=["elastic", "stiff"])
def test_energy_is_conserved(machine: plant.Machine) -> None:
    recording = plant.simulate(
        plant.axis_case(duration_s=8.0, seed=3, machine=machine, events=(plant.ProcessForce(),))
    )
    motor, push, friction, damping, kinetic, stored, tilt, _ = recording.truth["energy"]
    assert min(motor, friction, damping) > 0.0
    assert motor + push == pytest.approx(friction + damping + kinetic + stored + tilt, rel=3e-3)


def test_it_sticks_at_rest_within_its_friction() -> None:
    path = plant.motions.Route(0.3).to(0.4, 0.2, 4.0, 4.0).positions()
    recording = plant.simulate(plant.axis_case(setpoint_m=path, stroke_map=(0, 0)))
    states = recording.truth["states"][-1000:]
    assert np.abs(states[:, 3]).max() < 1e-7
    assert np.ptp(states[:, 2]) < 5e-7
    breakaway = 1.5 * plant.Machine().coulomb_nm
    assert 0.0 < np.abs(states[:, 4]).max() < breakaway


def test_drag_follows_preload_and_ramps_and_steps_do_what_they_say() -> None:
    path = plant.motions.Route(0.1).to(0.7, 0.15, 4.0, 0.1).positions()
    shares = {}
    for percent in (6.8456, 3.4228):
        recording = plant.simulate(plant.axis_case(percent, setpoint_m=path, stroke_map=(0, 0)))
        shares[percent] = float(np.median(recording.truth["forces"]["nut_friction_nm"]))
        viscous = recording.truth["parameters"]["nut_visc"] * 0.15 / plant.DIAGNOSIS.lead_rad
        shares[percent] -= viscous
    assert shares[6.8456] == pytest.approx(2 * shares[3.4228], rel=1e-3)
    assert shares[6.8456] == pytest.approx(plant.Machine().preload_drag_nm, rel=0.03)
    time_s = np.arange(0.0, 100.0, 0.01)
    assert preload_trajectory(plant.Ramp(10.0, 0.0, 20.0, 60.0), time_s)[4000] == pytest.approx(5.0)
    steps = preload_trajectory(plant.Steps(7.0, ((30.0, 5.0), (70.0, 0.0))), time_s)
    assert [steps[2999], steps[3000], steps[-1]] == [7.0, 5.0, 0.0]


def test_events_change_what_they_name_and_leave_the_preload() -> None:
    events = (
        plant.Warmup(time_constant_s=3.0),
        plant.Payload(((5.0, 12.0),)),
        plant.Relubrication(6.0),
    )
    plan = planned(plant.axis_case(duration_s=12.0, events=events, seed=2))
    plain = planned(plant.axis_case(duration_s=12.0, seed=2))
    assert np.array_equal(plan.slow["preload_n"], plain.slow["preload_n"])
    assert plan.slow["table_kg"][-1] - plan.slow["table_kg"][0] == pytest.approx(12.0)
    for part in ("guide", "nut", "viscous"):
        assert plan.slow[part][0] == pytest.approx(1.0, abs=0.01)
        assert plan.slow[part][500] < 0.95
    dry = planned(plant.axis_case(duration_s=12.0, events=events[:2], seed=2))
    moved_s = np.sum(np.abs(np.diff(plan.setpoint_m[6000:])) > 1e-6) * 1e-3
    eased = plan.slow["guide"][-1] / dry.slow["guide"][-1]
    assert eased == pytest.approx(1.0 - 0.25 * (1.0 - np.exp(-moved_s / 3.0)), abs=0.01)
    assert np.all(plan.growth_m[:, 0] == 0.0)
    assert np.all(np.diff(plan.growth_m[5]) >= -1e-12)
    assert 1e-6 < plan.growth_m[-1, -1] < 60e-6


# --- effects ---------------------------------------------------------------------------------


def short_path() -> np.ndarray:
    """Rest after either direction, slow and fast strokes: 12 s."""
    route = plant.motions.Route(0.24).add(plant.motions.rest(0.2)).to(0.26, 0.03, 2.0, 0.8)
    for place in (0.255, 0.262, 0.27):
        route.to(place, 0.008, 2.0, 0.1)
    return route.to(0.7, 0.3, 5.0, 0.1).to(0.15, 0.6, 5.0, 0.2).to(0.7, 0.2, 3.0, 0.1).positions()


@pytest.fixture(scope="module")
def healthy() -> Recording:
    return plant.simulate(plant.case((), short_path(), seed=5, sensors=QUIET))


@pytest.mark.parametrize("name", plant.ALL)
def test_an_effect_shows_in_its_channel_and_only_there(name: str, healthy: Recording) -> None:
    recording = plant.simulate(plant.case(((name, 1.0),), short_path(), seed=5, sensors=QUIET))
    fault = plant.ALL[name]
    before, after = plant.gap(healthy, plant.DIAGNOSIS), plant.gap(recording, plant.DIAGNOSIS)
    added = {name: np.sqrt(max(after[name] ** 2 - before[name] ** 2, 0.0)) for name in before}
    assert recording.truth["effects"][name]["strength"] == 1.0
    for channel, floor in (("torque_nm", 0.01), ("transmission_m", 4e-8)):
        if fault.channel in ("both", channel):
            assert added[channel] > 1.5 * floor
        else:
            assert added[channel] < floor


# --- recordings ------------------------------------------------------------------------------


def test_the_same_case_gives_the_same_recording() -> None:
    first, second = (
        plant.simulate(plant.axis_case(duration_s=2.0, seed=4, axis_seed=9)) for _ in range(2)
    )
    for name, column in first.columns.items():
        np.testing.assert_array_equal(column, second.columns[name])
    other = plant.simulate(plant.axis_case(duration_s=2.0, seed=5, axis_seed=9))
    assert other.truth["parameters"] == first.truth["parameters"]
    assert not np.array_equal(other.columns["motor_angle_rad"], first.columns["motor_angle_rad"])
    assert (
        plant.simulate(plant.axis_case(duration_s=2.0, seed=4, axis_seed=8)).truth["parameters"]
        != first.truth["parameters"]
    )
