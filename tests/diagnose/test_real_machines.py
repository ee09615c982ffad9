"""Real machines with faults that others seeded, recorded as slowly as others record.

Cranfield (CORD 5097649): a linear actuator at 25 Hz, its current unsigned; faults are told beside
recordings of the healthy actuator. Screw actuators: 100 Hz, a data sheet and no more.
"""

import csv
import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli import main
from edge_service.messages.samples import Floats

from .test_bad_input import written

DATA = Path(__file__).parents[3] / "shared" / "data"
SEQUENCES = 10
"""Moves there and back that make one recording."""
FRICTION = {"drag_error", "viscous_error", "warmup", "load_friction", "torque_gain_error"}
"""At one speed and without the sign of the current all of these are the same."""
ACTUATOR_TOML = """
[axis]
name = "A"
lead_m = 0.005

[model]
inertia_kg_m2 = { value = 3e-5, tolerance = 0.3 }
viscous_nm_s_per_rad = { value = 1e-5, tolerance = 1.0 }
preload_drag_nm = { value = 0.05, tolerance = 0.5 }
"""
SCREW_TOML = """
[axis]
name = "LinA"
lead_m = 0.006

[model]
inertia_kg_m2 = { value = 5.2e-4, tolerance = 0.3 }
viscous_nm_s_per_rad = { value = 1e-3, tolerance = 1.0 }
preload_drag_nm = { value = 0.02, tolerance = 1.0 }
"""
NM_PER_A = 0.0429 * 624.0 / 35.0


def needs(folder: str) -> None:
    if not (DATA / folder).is_dir():
        pytest.skip(f"the recordings of {folder} are not here")


def moves(condition: str, load: str) -> Iterator[Floats]:
    """Sequences of one load: time s, setpoint mm, position error mm, current A, (n, 4) each."""
    with (DATA / "cranfield" / f"{condition}.csv").open() as file:
        rows = [
            [float(row[name]) for name in ("time", "set_point", "position_error", "current")]
            for row in csv.DictReader(file)
            if row["load"] == load
        ]
    table = np.array(rows)
    yield from np.split(table, np.flatnonzero(np.diff(table[:, 0]) < 0.0) + 1)


def recordings(folder: Path, condition: str, load: str) -> list[str]:
    """Traces of some sequences each; the current has the sign of the motion that is asked for."""
    every = list(moves(condition, load))
    paths = []
    for start in range(0, len(every), SEQUENCES):
        part, clock_s = [], 0.0
        for each in every[start : start + SEQUENCES]:
            way = np.sign(np.gradient(each[:, 1]))
            position = 1e-3 * (each[:, 1] - each[:, 2])
            torque = 0.1 * each[:, 3] * way
            part.append(np.column_stack((each[:, 0] + clock_s, torque, position)))
            clock_s = float(part[-1][-1, 0]) + 1.0
        columns = dict(
            zip(
                ("time_s", "torque_command_nm", "table_position_m"),
                np.vstack(part).T,
                strict=True,
            )
        )
        paths.append(written(folder / f"{condition}{start}.csv", columns))
    return paths


def diagnosed(
    folder: Path, machine: str, trace: str, reference: Sequence[str] = ()
) -> dict[str, object]:
    (folder / "machine.toml").write_text(machine)
    out = folder / "out"
    given = ["diagnose", "--machine", str(folder / "machine.toml"), trace, "--out", str(out)]
    status = main([*given, *(["--reference", *reference] if reference else [])])
    document: dict[str, object] = json.loads((out / "diagnosis.json").read_text())
    assert status == (3 if document["verdict"] == "bad_data" else 0)
    return document


@pytest.mark.slow
@pytest.mark.parametrize("load", ["20", "40", "-40"])
def test_the_healthy_actuator_repeats_itself(tmp_path: Path, load: str) -> None:
    needs("cranfield")
    *reference, first, last = recordings(tmp_path, "normal", load)
    for trace in (first, last):
        assert diagnosed(tmp_path, ACTUATOR_TOML, trace, reference)["verdict"] == "no_gap"


@pytest.mark.slow
@pytest.mark.parametrize("load", ["20", "40"])
def test_a_lack_of_lubrication_is_friction(tmp_path: Path, load: str) -> None:
    needs("cranfield")
    reference = recordings(tmp_path, "normal", load)[:3]
    for trace in recordings(tmp_path, "lackLubrication1", load)[:2]:
        found = diagnosed(tmp_path, ACTUATOR_TOML, trace, reference)
        assert found["verdict"] in ("explained", "ambiguous")
        named = {name for each in found["effects"] for name in each["class"]}
        assert "drag_error" in named
        assert named - {"external_force"} <= FRICTION


@pytest.mark.slow
@pytest.mark.parametrize("load", ["20", "-40"])
def test_play_behind_one_encoder_is_not_taken_for_something_else(tmp_path: Path, load: str) -> None:
    needs("cranfield")
    reference = recordings(tmp_path, "normal", load)[:3]
    for trace in recordings(tmp_path, "backlash1", load)[:2]:
        found = diagnosed(tmp_path, ACTUATOR_TOML, trace, reference)
        assert all(each["probability"] < 0.9 for each in found["effects"])
        assert "one encoder only" in found["not_judged_reasons"]["backlash"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "LinA_no-load-square-wave-full-travel-0.5Hz",
        "LinA_no-pp-sine-sweep-10mm-0.5Hz",
        "LinA_pp-sine-sweep-10mm-0.5Hz",
        "LinA_pp-square-wave-10mm-0.5Hz",
    ],
)
def test_a_screw_actuator_with_a_data_sheet_has_an_answer(tmp_path: Path, name: str) -> None:
    needs("screw_actuators")
    table = np.loadtxt(DATA / "screw_actuators" / f"{name}.txt")
    columns = {
        "time_s": 1e-3 * table[:, 0],
        "torque_command_nm": NM_PER_A * 1e-3 * table[:, 5],
        "table_position_m": 1e-3 * table[:, 3],
        "position_setpoint_m": 1e-3 * table[:, 1],
    }
    found = diagnosed(tmp_path, SCREW_TOML, written(tmp_path / "a.csv", columns))
    assert bool(found["reasons"]) == (found["verdict"] == "bad_data")
    for each in found["effects"]:
        assert each["shrink"]["high"] > 0.0
        assert each["channel"] == "torque_nm"


@pytest.mark.parametrize("command", [["gap"], ["diagnose", "--out", "out"]])
def test_a_machine_of_several_axes_asks_for_the_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys, command: list[str]
) -> None:
    needs("kit_dmc60h")
    monkeypatch.chdir(tmp_path)
    Path("machine.toml").write_text(ACTUATOR_TOML)
    lines = (DATA / "kit_dmc60h" / "excerpt.csv").read_text().splitlines()
    timed = [f"{0.002 * k:.3f},{line}" for k, line in enumerate(lines[1:])]
    Path("a.csv").write_text("\n".join([f"time_s,{lines[0]}", *timed]) + "\n")
    given = [*command, "--machine", "machine.toml", "a.csv"]
    assert main(given) == 2
    said = capsys.readouterr().err
    assert "axes there are: 1, 2, 3, 6" in said
    assert said.count("\n") == 1
    assert main([*given, "--axis-number", "9"]) == 2
    assert "no signal of axis 9" in capsys.readouterr().err
    assert main([*given, "--axis-number", "1"]) in (0, 2, 3)
    assert "axes there are" not in capsys.readouterr().err
