"""What is no fit recording for `gap` and `diagnose`: a clear line or verdict, never a traceback."""

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli import main

from .conftest import recorded


@pytest.fixture(autouse=True)
def few_twins(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("edge_service.studies.diagnose.HEALTHY_RUNS", 2)


def written(path: Path, columns: dict[str, np.ndarray]) -> str:
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    return str(path)


def sound(**changes: np.ndarray | None) -> dict[str, np.ndarray]:
    columns = {**recorded((), seed=3).columns, **changes}
    return {name: values for name, values in columns.items() if values is not None}


def diagnosed(machine_file: Path, tmp_path: Path, *traces: str) -> dict[str, object]:
    out = tmp_path / "out"
    command = ["diagnose", "--machine", str(machine_file), *traces, "--out", str(out)]
    assert main(command) == 0
    document: dict[str, object] = json.loads((out / "diagnosis.json").read_text())
    return document


def refused(machine_file: Path, tmp_path: Path, capsys, *traces: str) -> str:
    """The one line that both commands say."""
    out = tmp_path / "out"
    capsys.readouterr()
    lines = []
    for command in (["diagnose", "--out", str(out)], ["gap", "--json"]):
        assert main([*command, "--machine", str(machine_file), *traces]) == 2
        answer = capsys.readouterr()
        assert answer.out == ""
        assert answer.err.count("\n") == 1
        lines.append(answer.err)
    assert not out.exists()
    return lines[0]


@pytest.mark.parametrize(
    ("lacking", "says"),
    [
        (("time_s",), "time_s"),
        (
            ("motor_angle_rad", "table_position_m", "motor_speed_rad_s", "table_speed_m_s"),
            "motor_angle_rad",
        ),
    ],
)
def test_a_channel_without_which_nothing_can_be_said(machine_file, tmp_path, capsys, lacking, says):
    columns = sound(**dict.fromkeys(lacking))
    trace = written(tmp_path / "a.csv", columns)
    assert says in refused(machine_file, tmp_path, capsys, trace)


@pytest.mark.parametrize(
    ("lacking", "remark"),
    [("torque_command_nm", "no torque_command_nm"), ("table_position_m", "one encoder only")],
)
def test_a_channel_less_is_a_remark(machine_file, tmp_path, lacking, remark):
    trace = written(tmp_path / "a.csv", sound(**{lacking: None}))
    document = diagnosed(machine_file, tmp_path, trace)
    assert document["verdict"] != "bad_data"
    assert any(remark in each for each in document["remarks"])
    assert document["not_judged"]


@pytest.mark.parametrize(
    ("channel", "factor", "says"),
    [
        ("torque_command_nm", 1000.0, "N m"),
        ("table_position_m", 1000.0, "unit or the lead"),
        ("motor_angle_rad", 57.29577951308232, "unit or the lead"),
    ],
)
def test_a_wrong_unit_is_bad_data(machine_file, tmp_path, channel, factor, says):
    values = factor * recorded((), seed=3).columns[channel]
    trace = written(tmp_path / "a.csv", sound(**{channel: values}))
    document = diagnosed(machine_file, tmp_path, trace)
    assert document["verdict"] == "bad_data"
    assert says in " ".join(document["reasons"])


@pytest.mark.parametrize("text", ["", "time_s,torque_command_nm,motor_angle_rad\n"])
def test_an_empty_trace(machine_file, tmp_path, capsys, text):
    trace = tmp_path / "a.csv"
    trace.write_text(text)
    assert str(trace) in refused(machine_file, tmp_path, capsys, str(trace))


def test_a_constant_trace(machine_file, tmp_path):
    columns = {name: np.full_like(each, each[0]) for name, each in sound().items()}
    columns["time_s"] = recorded((), seed=3).columns["time_s"]
    document = diagnosed(machine_file, tmp_path, written(tmp_path / "a.csv", columns))
    assert document["verdict"] == "bad_data"


def test_three_seconds_name_nothing_and_say_that_they_are_short(machine_file, tmp_path):
    columns = {name: each[:3000] for name, each in sound().items()}
    document = diagnosed(machine_file, tmp_path, written(tmp_path / "a.csv", columns))
    assert document["verdict"] == "no_gap"
    assert document["effects"] == []
    assert any("of motion in all" in each for each in document["remarks"])


def test_recordings_of_different_axes(machine_file, tmp_path):
    """The second axis has four times the inertia and friction, as its torque shows."""
    columns = sound()
    first = written(tmp_path / "a.csv", columns)
    other = columns | {"torque_command_nm": 4.0 * columns["torque_command_nm"]}
    document = diagnosed(machine_file, tmp_path, first, written(tmp_path / "b.csv", other))
    assert document["verdict"] == "bad_data"
    assert "one axis" in " ".join(document["reasons"])


def test_an_effect_that_the_machine_file_has_explains_the_gap_at_once(machine_file, tmp_path):
    trace = written(tmp_path / "a.csv", recorded(("backlash",), 3).columns)
    first = diagnosed(machine_file, tmp_path, trace)
    assert "backlash" in [each["name"] for each in first["effects"]]
    known = tmp_path / "known.toml"
    known.write_text((tmp_path / "out" / "augmented.toml").read_text())
    again = diagnosed(known, tmp_path, trace)
    before, after = (each["gap"]["transmission_m"]["before"] for each in (first, again))
    assert after == pytest.approx(first["gap"]["transmission_m"]["after"], rel=0.02)
    assert after < 0.2 * before
    assert all(each["shrink"]["estimate"] < 0.5 for each in again["effects"])


@pytest.mark.slow
def test_two_hours_in_bounded_memory(machine_file, tmp_path):
    columns = sound()
    rows = len(columns["time_s"])
    repeats = 7200 * 1000 // rows
    path = tmp_path / "long.csv"
    text = np.column_stack([each for name, each in columns.items() if name != "time_s"])
    with path.open("w") as file:
        file.write("time_s," + ",".join(name for name in columns if name != "time_s") + "\n")
        lines = [",".join(f"{value:.8g}" for value in row) for row in text]
        for repeat in range(repeats):
            start_s = repeat * (rows * 1e-3 + 1.0)
            file.writelines(f"{start_s + k * 1e-3:.4f},{line}\n" for k, line in enumerate(lines))
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    command = ["gap", "--machine", str(machine_file), str(path), "--json"]
    subprocess.run([sys.executable, "-m", "edge_service", *command], check=True, timeout=500)
    assert max(before, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) < 1_500_000
