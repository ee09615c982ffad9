"""`edge-service drift` on recordings: the real actuator, program sections, and what is refused."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.offline.drift import DriftReport, compare_days
from edge_service.offline.recordings import read_recording

from ..bench.real_machines import ACTUATOR_TOML, DATA

CRANFIELD = DATA / "cranfield"
real = pytest.mark.skipif(not CRANFIELD.is_dir(), reason=f"needs {CRANFIELD}, a real actuator")
COLUMNS = """
[columns]
time_s = "time"
table_position_m = { column = "set_point", minus = "position_error", scale = 0.001 }
position_setpoint_m = { column = "set_point", scale = 0.001 }
torque_command_nm = { column = "current", scale = 0.1, direction = "set_point" }
"""


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    file = tmp_path / "m.toml"
    file.write_text(ACTUATOR_TOML + COLUMNS)
    return file


def drift(machine_file: Path, traces: Sequence[Path], by: Sequence[str] = ()) -> DriftReport:
    machine = load_machine(machine_file)
    read = {path: read_recording(machine, path, keep_all=True) for path in traces}
    return compare_days(machine, read, by)


def friction_at(report: DriftReport, load: float) -> tuple[float, bool]:
    section = next(s for s in report.sections if s.section.pattern.context == (load,))
    friction = next(each for each in section.drifts if each.name == "friction_nm")
    return friction.relative, friction.since is not None


@real
def test_a_lack_of_lubrication_is_the_friction_that_others_found(machine: Path) -> None:
    """Mean current both ways at 20 kgf: +13.7 % (README beside the data)."""
    worn = CRANFIELD / "lackLubrication1.csv"
    report = drift(machine, [CRANFIELD / "normal.csv", worn], by=["load"])
    relative, changed = friction_at(report, 20.0)
    assert changed
    assert relative == pytest.approx(0.137, abs=0.02)
    loads = [d for s in report.sections for d in s.drifts if d.name == "load_nm"]
    assert len(loads) == 3
    assert not any(any(each.changed) for each in loads)


@real
def test_a_current_without_a_sign_is_refused(machine: Path, capsys) -> None:
    machine.write_text(machine.read_text().replace(', direction = "set_point"', ""))
    days = [str(CRANFIELD / f"{name}.csv") for name in ("normal", "backlash1")]
    assert main(["drift", *days, "--machine", str(machine)]) == 2
    assert "torque_command_nm stays on one side both ways" in capsys.readouterr().err


@real
def test_backlash_is_no_more_friction(machine: Path) -> None:
    """The same: -3.7 %, where the healthy actuator varies by 2 %."""
    report = drift(machine, [CRANFIELD / "normal.csv", CRANFIELD / "backlash1.csv"], by=["load"])
    relative, _ = friction_at(report, 20.0)
    assert relative == pytest.approx(-0.037, abs=0.02)


@real
def test_two_halves_of_the_healthy_actuator_are_alike(machine: Path, tmp_path: Path) -> None:
    halves = {True: tmp_path / "early.csv", False: tmp_path / "late.csv"}
    with (CRANFIELD / "normal.csv").open() as file:
        rows = list(csv.DictReader(file))
    for early, path in halves.items():
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(row for row in rows if (int(row["run"]) <= 5) is early)
    report = drift(machine, list(halves.values()), by=["load"])
    assert report.verdict.startswith("nothing changed beyond repeat scatter")


@pytest.mark.skipif(not (DATA / "emps").is_dir(), reason="needs the EMPS recordings")
def test_pulses_of_force_are_neither_friction_nor_load() -> None:
    """The second record has pulses of force along the same moves, the axis is the same."""
    files = [DATA / "emps" / f"emps_{name}.csv" for name in ("estimation", "validation_pulses")]
    (section,) = drift(Path(__file__).parents[2] / "deploy/emps.toml", files).sections
    changed = {each.name: each.since is not None for each in section.drifts}
    assert not changed["friction_nm"]
    assert not changed["load_nm"]
    assert changed["torque_spread_nm"]


def written(path: Path, friction_nm: float, *, seed: int, span_m: float = 0.1) -> Path:
    """Moves of `span_m` there and back at two tools, 4 times each, at 200 Hz; gravity .1 N m."""
    rng = np.random.default_rng(seed)
    step_s, speed = 0.005, 0.1
    there = np.full(round(span_m / speed / step_s), speed)
    still = np.zeros(60)
    cycle = np.concatenate([still, there, still, -there])
    velocity = np.concatenate([np.tile(cycle, 8), still])
    position = np.cumsum(velocity) * step_s
    tool = np.repeat([1.0, 2.0], [4 * len(cycle), 4 * len(cycle) + len(still)])
    friction = friction_nm * np.where(tool == 2.0, 2.0, 1.0)
    torque = 0.1 + friction * np.sign(velocity) + 0.004 * rng.standard_normal(len(velocity))
    columns = {
        "time_s": np.arange(len(velocity)) * step_s,
        "torque_command_nm": torque,
        "table_position_m": position + 1e-7 * rng.standard_normal(len(velocity)),
        "position_setpoint_m": position,
        "HFBlockEvent.ActiveTool": tool,
    }
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, fmt="%.9g", delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.mark.slow
def test_each_tool_is_compared_with_itself(machine: Path, tmp_path: Path, capsys) -> None:
    machine.write_text(ACTUATOR_TOML)
    days = [str(written(tmp_path / f"{k}.csv", f, seed=k)) for k, f in enumerate((0.2, 0.2, 0.23))]
    out = tmp_path / "out"
    assert main(["drift", *days, "--machine", str(machine), "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "ActiveTool 1" in text
    assert "ActiveTool 2" in text
    assert "since 2.csv" in text
    assert "temperature: not recorded" in text
    said = main(["fingerprint", *days, "--machine", str(machine), "--out", str(tmp_path / "print")])
    assert said == 0
    page = (tmp_path / "print" / "report.html").read_text()
    assert "The same moves from recording to recording" in page
    assert "since 2.csv" in page
    assert (tmp_path / "print" / "drift.json").read_bytes() == (out / "drift.json").read_bytes()
    found = json.loads((out / "drift.json").read_text())
    assert len(found["sections"]) == 2
    for section, factor in zip(found["sections"], (1.0, 2.0), strict=True):
        quantities = {each["name"]: each for each in section["quantities"]}
        assert quantities["friction_nm"]["values"] == pytest.approx(
            [0.2 * factor, 0.2 * factor, 0.23 * factor], rel=0.02
        )
        assert quantities["friction_nm"]["changed_since"] == "2.csv"
        assert quantities["load_nm"]["values"] == pytest.approx([0.1] * 3, rel=0.03)
        assert quantities["load_nm"]["changed_since"] is None


def test_what_has_nothing_in_common_is_refused(machine: Path, tmp_path: Path, capsys) -> None:
    machine.write_text(ACTUATOR_TOML)
    first = str(written(tmp_path / "a.csv", 0.2, seed=1))
    other = str(written(tmp_path / "b.csv", 0.2, seed=2, span_m=0.15))
    assert main(["drift", first, other, "--machine", str(machine)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "b.csv has mostly" in told
    assert main(["drift", first, "--machine", str(machine)]) == 2
    assert "two recordings" in capsys.readouterr().err
    assert main(["drift", first, other, "--machine", str(machine), "--by", "tool"]) == 2
    assert "no column 'tool'" in capsys.readouterr().err
