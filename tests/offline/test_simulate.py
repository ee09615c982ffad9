import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from edge_service.config import DEFAULT_MACHINE
from edge_service.messages import samples as channels
from edge_service.messages.samples import Floats
from edge_service.models.machine import Machine
from edge_service.models.motions.registry import MOTIONS, motion_limits
from edge_service.offline.simulate import (
    SimulationError,
    SimulationSettings,
    simulate,
    simulate_session,
)
from edge_service.recordings.columns import TraceError
from edge_service.recordings.reader import read_trace

SHORT = SimulationSettings(duration_s=3.0)


def read(path: Path) -> dict[str, Floats]:
    frame = read_trace(path)
    return {channels.TIME: frame.time_s, **frame.channels}


def test_the_trace_has_every_channel_at_the_rate(machine: Machine, tmp_path: Path) -> None:
    line = simulate(machine, SHORT, tmp_path / "a.csv").words
    trace = read(tmp_path / "a.csv")
    assert tuple(trace) == (channels.TIME, *channels.CHANNELS)
    assert trace[channels.TIME] == pytest.approx(np.arange(3000) / 1000.0)
    assert "3000 rows" in line
    assert all(np.isfinite(values).all() for values in trace.values())


def test_a_seed_fixes_the_bytes(machine: Machine, tmp_path: Path) -> None:
    settings = replace(SHORT, effects=("stribeck", "backlash:width_m=5e-6"), seed=7)
    names = ("a", "b", "c")
    for name, seed in zip(names, (7, 7, 8), strict=True):
        simulate(machine, replace(settings, seed=seed), tmp_path / f"{name}.csv")
    first, second, other = ((tmp_path / f"{name}.csv").read_bytes() for name in names)
    assert first == second != other


def test_a_finite_motion_runs_to_its_end(machine: Machine, tmp_path: Path) -> None:
    simulate(machine, SimulationSettings(motion="standstill"), tmp_path / "a.csv")
    trace, limits = read(tmp_path / "a.csv"), motion_limits(machine)
    own_s = MOTIONS["standstill"].duration_s(limits)
    assert own_s is not None
    assert trace[channels.TIME][-1] == pytest.approx(own_s, abs=0.1)
    assert trace[channels.SETPOINT][-1] == pytest.approx(limits.low_m, abs=1e-5)


def test_a_payload_turns_and_is_not_known_to_the_drive(machine: Machine, tmp_path: Path) -> None:
    simulate(machine, SHORT, tmp_path / "plain.csv")
    loaded = replace(SHORT, effects=("payload:mass_kg=200",))
    simulate(machine, loaded, tmp_path / "loaded.csv")
    torques = [read(tmp_path / f"{name}.csv")[channels.TORQUE] for name in ("plain", "loaded")]
    assert np.max(np.abs(torques[1])) > 1.2 * np.max(np.abs(torques[0]))


def test_the_known_force_stands_in_the_record_and_the_unknown_does_not(
    machine: Machine, tmp_path: Path
) -> None:
    (tmp_path / "force.csv").write_text("time_s,force_n\n0,100\n100,100\n")
    known = replace(SHORT, effects=(f"external_force:file={tmp_path / 'force.csv'}",))
    unknown = replace(SHORT, effects=("external_force:force_n=100,start_s=0,duration_s=100",))
    traces = []
    for name, settings in (("plain", SHORT), ("known", known), ("unknown", unknown)):
        simulate(machine, settings, tmp_path / f"{name}.csv")
        traces.append(read(tmp_path / f"{name}.csv"))
    plain, pushed, secret = traces
    assert np.mean(pushed[channels.EXTERNAL_FORCE]) == pytest.approx(100.0, abs=0.2)
    assert np.mean(secret[channels.EXTERNAL_FORCE]) == pytest.approx(0.0, abs=0.2)
    expected_nm = -100.0 * 0.02 / (2.0 * np.pi)
    for trace in (pushed, secret):
        change = np.median(trace[channels.TORQUE] - plain[channels.TORQUE])
        assert change == pytest.approx(expected_nm, abs=0.01)


def test_a_process_pushes_in_its_cuts_alone(machine: Machine, tmp_path: Path) -> None:
    for process, pause in (("milling", 6500), ("drilling", 4500)):
        cutting = SimulationSettings(duration_s=8.0, effects=(f"{process}:force_n=-400",))
        simulate(machine, cutting, tmp_path / "cut.csv")
        force_n = read(tmp_path / "cut.csv")[channels.EXTERNAL_FORCE]
        means = np.mean(force_n[1000:3000]), np.mean(force_n[pause : pause + 1000])
        assert means == pytest.approx((-400.0, 0.0), abs=0.5)


def test_less_preload_is_less_torque(machine: Machine, tmp_path: Path) -> None:
    moving = []
    for percent in (6.0, 2.0):
        path = tmp_path / f"{percent}.csv"
        simulate(machine, replace(SHORT, preload_percent=percent), path)
        trace = read(path)
        speed = trace[channels.MOTOR_SPEED]
        cruise = np.abs(speed) > 5.0
        moving.append(np.mean((trace[channels.TORQUE] * np.sign(speed))[cruise]))
    per_percent = 0.146 / (100.0 * 510.0 / 7450.0)
    assert moving[0] - moving[1] == pytest.approx(4.0 * per_percent, rel=0.05)


def test_effects_of_the_machine_file_are_simulated_too(machine: Machine, tmp_path: Path) -> None:
    content = tomllib.loads(DEFAULT_MACHINE.read_text())
    content["effects"] = [{"name": "load_offset", "parameters": {"constant_nm": 0.5}}]
    line = simulate(Machine.model_validate(content), SHORT, tmp_path / "a.csv").words
    assert line.endswith("effects: load_offset")
    simulate(machine, SHORT, tmp_path / "b.csv")
    change = read(tmp_path / "a.csv")[channels.TORQUE] - read(tmp_path / "b.csv")[channels.TORQUE]
    assert np.median(change) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motion": "polka"}, "motion: 'polka' is not one of .*production"),
        ({"effects": ("stribek",)}, "no effect 'stribek'; did you mean 'stribeck'?"),
        ({"effects": ("stribeck:excess_nm=99",)}, "excess_nm: expected -5 to 5 N m, got 99"),
        ({"effects": ("inertia_error:change_kg_m2=-0.01",)}, "leave a table of"),
        ({"preload_percent": -1.0}, "preload: expected 0 to 100 %, got -1"),
        ({"effects": ("payload:mass_kg=-1",)}, "expected payload:mass_kg=KILOGRAMS"),
        ({"effects": ("external_force:file=no.csv",)}, r"no\.csv: cannot be read"),
        ({"effects": ("drilling:force_n=much",)}, "expected drilling:force_n=NEWTONS"),
        ({"duration_s": 0.0}, "duration: .* got 0 s"),
    ],
)
def test_bad_input_is_one_line_and_leaves_no_file(
    machine: Machine, tmp_path: Path, change: dict[str, object], message: str
) -> None:
    with pytest.raises(SimulationError, match=message) as raised:
        simulate(machine, replace(SHORT, **change), tmp_path / "a.csv")  # type: ignore[arg-type]
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_preload_in_percent_needs_a_machine_that_knows_it(tmp_path: Path) -> None:
    bare = Machine.model_validate({"axis": {"lead_m": 0.02}, "model": {"inertia_kg_m2": 1.5e-3}})
    simulate(bare, SHORT, tmp_path / "a.csv")
    with pytest.raises(SimulationError, match=r"axis\.dynamic_load_rating_n"):
        simulate(bare, replace(SHORT, preload_percent=5.0), tmp_path / "b.csv")


SESSION = ("standstill", "warmup:duration_s=4", "standstill")


def test_a_session_is_one_axis_and_one_clock(machine: Machine, tmp_path: Path) -> None:
    words = simulate_session(machine, SimulationSettings(seed=3), SESSION, tmp_path / "runs").words
    paths = sorted((tmp_path / "runs").iterdir())
    names = ["01_standstill.parquet", "02_warmup.parquet", "03_standstill.parquet"]
    assert [path.name for path in paths] == names
    assert [line.split(":")[0] for line in words.splitlines()] == [str(path) for path in paths]
    traces = [read(path) for path in paths]
    time_s = np.concatenate([trace[channels.TIME] for trace in traces])
    assert time_s == pytest.approx(np.arange(len(time_s)) / 1000.0)
    home_m = motion_limits(machine).low_m
    for trace in traces:
        assert trace[channels.SETPOINT][[0, -1]] == pytest.approx([home_m] * 2, abs=1e-6)
        assert abs(trace[channels.TABLE_POSITION][-1] - home_m) < 1e-4
    assert np.ptp(traces[1][channels.SETPOINT]) > 0.5
    again = traces[0][channels.TORQUE] - traces[2][channels.TORQUE]
    assert np.std(again) > 0.0, "the noise goes on, it does not begin again"


def test_a_session_begins_as_its_first_motion_alone(machine: Machine, tmp_path: Path) -> None:
    settings = SimulationSettings(motion="standstill", seed=3)
    simulate(machine, settings, tmp_path / "alone.parquet")
    simulate_session(machine, settings, ("standstill", "standstill"), tmp_path / "runs")
    alone = (tmp_path / "alone.parquet").read_bytes()
    assert (tmp_path / "runs" / "01_standstill.parquet").read_bytes() == alone


def test_the_axis_of_a_session_warms_up_from_file_to_file(machine: Machine, tmp_path: Path) -> None:
    excess_nm, tau_s = 0.2, 20.0
    warms = SimulationSettings(effects=(f"warmup:excess_nm={excess_nm},time_constant_s={tau_s}",))
    simulate_session(machine, warms, ("warmup:duration_s=8",) * 3, tmp_path)
    levels, faded = [], []
    for path in sorted(tmp_path.iterdir()):
        trace = read(path)
        speed = trace[channels.MOTOR_SPEED]
        cruise = np.abs(np.abs(speed) - 0.5 / 0.02 * 2.0 * np.pi) < 0.2
        levels.append(np.mean((trace[channels.TORQUE] * np.sign(speed))[cruise]))
        faded.append(np.mean(excess_nm * np.exp(-trace[channels.TIME][cruise] / tau_s)))
    assert np.diff(levels) == pytest.approx(np.diff(faded), rel=0.03)


@pytest.mark.parametrize(
    ("motions", "message"),
    [
        (("standstill", "polka"), "motion: 'polka' is not one of"),
        (("standstill", "warmup:speed=2"), "motion warmup: 'speed=2', expected duration_s=SECONDS"),
        (("standstill", "warmup:duration_s=long"), "duration_s: 'long' is no number"),
        (("standstill", "warmup:duration_s=nan"), "duration: expected a time above 0 s"),
        (("friction:duration_s=3", "standstill"), "takes 131.0 s, .* 3 s would cut it"),
        (("warmup:duration_s=0.5", "standstill"), "its first move takes longer than 0.5 s"),
    ],
)
def test_a_wrong_session_is_one_line_and_leaves_no_folder(
    machine: Machine, tmp_path: Path, motions: tuple[str, ...], message: str
) -> None:
    with pytest.raises(SimulationError, match=message) as raised:
        simulate_session(machine, SimulationSettings(), motions, tmp_path / "runs")
    assert "\n" not in str(raised.value)
    assert not list(tmp_path.iterdir())


def test_recordings_of_another_session_are_not_mixed_in(machine: Machine, tmp_path: Path) -> None:
    settings = SimulationSettings()
    (tmp_path / "notes.txt").write_text("mine")
    for _ in range(2):
        simulate_session(machine, settings, ("warmup:duration_s=3",) * 3, tmp_path)
    with pytest.raises(SimulationError, match=r"03_warmup\.parquet: is of another session"):
        simulate_session(machine, settings, ("warmup:duration_s=3",) * 2, tmp_path)
    with pytest.raises(SimulationError, match="has two durations"):
        simulate(machine, SimulationSettings("warmup:duration_s=3", duration_s=3.0), tmp_path / "a")


def test_a_folder_that_cannot_be_is_one_line(machine: Machine, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TraceError, match=r"file: no folder for recordings"):
        simulate_session(machine, SimulationSettings(), SESSION, tmp_path / "file")
