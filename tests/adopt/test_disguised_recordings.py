"""A recording of the foreign plant in many disguises: each is seen through, or said unknown."""

import csv
import math
import tomllib
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edge_service.checks.columns.guess import Known
from edge_service.config import load_machine
from edge_service.offline.adopt import adopt
from edge_service.offline.recordings import read_recording
from edge_service.recordings.columns import TraceError

from ..foreign_plant import DIAGNOSIS, case, simulate

Columns = dict[str, Any]
LEAD_MM = 1e3 * DIAGNOSIS.lead_m
TURN = 2.0 * math.pi


@lru_cache(maxsize=1)
def truth() -> Columns:
    """Eleven seconds of production at 1 kHz, in SI units."""
    columns = simulate(case(motion="production", duration_s=12.0, seed=5)).columns
    return {name: np.array(values) for name, values in columns.items()}


def write(path: Path, columns: Columns) -> Path:
    with path.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        rows.writerows(zip(*(np.asarray(each).tolist() for each in columns.values()), strict=True))
    return path


NAMED = tomllib.loads(Path(__file__).with_name("disguises.toml").read_text("utf-8"))


def renamed(disguise: str) -> Columns:
    """Columns under other names, each divided by its factor to SI."""
    t = truth()
    return {name: t[channel] / factor for channel, (name, factor) in NAMED[disguise].items()}


def german() -> Columns:
    return renamed("German")


def inverted_torque() -> Columns:
    columns = german()
    return columns | {"Drehmoment [Nm]": -columns["Drehmoment [Nm]"]}


def inverted_angle() -> Columns:
    columns = german()
    return columns | {"Motorwinkel [°]": -columns["Motorwinkel [°]"]}


def industrial_edge() -> Columns:
    t = truth()
    return {
        "CYCLE": np.round(t["time_s"] / 0.001).astype(int)[::2] // 2,
        "DES_POS|3": 1e3 * t["position_setpoint_m"][::2],
        "ENC1_POS|3": t["motor_angle_rad"][::2] / TURN * LEAD_MM,
        "ENC2_POS|3": 1e3 * t["table_position_m"][::2],
        "TORQUE|3": t["torque_command_nm"][::2],
    }


def set_point_and_error() -> Columns:
    t = truth()
    return {
        "t_s": t["time_s"],
        "set_point_mm": 1e3 * t["position_setpoint_m"],
        "following_error_mm": 1e3 * (t["position_setpoint_m"] - t["table_position_m"]),
        "torque_nm": t["torque_command_nm"],
    }


DISGUISES: dict[str, tuple[Callable[[], Columns], Known]] = {
    **{name: (partial(renamed, name), Known()) for name in NAMED},
    "inverted torque": (inverted_torque, Known()),
    "inverted angle": (inverted_angle, Known()),
    "Industrial Edge": (industrial_edge, Known(lead_m=DIAGNOSIS.lead_m)),
    "set point and error": (set_point_and_error, Known(lead_m=DIAGNOSIS.lead_m)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", DISGUISES)
def test_a_machine_file_reads_disguised_recording_as_what_it_was(name: str, tmp_path: Path) -> None:
    disguise, known = DISGUISES[name]
    path, out = write(tmp_path / "r.csv", disguise()), tmp_path / "machine.toml"
    adopt([path], out, known=known)
    machine = load_machine(out)
    assert machine.axis.lead_m == pytest.approx(DIAGNOSIS.lead_m, rel=2e-3)
    frame = read_recording(machine, path)
    every = len(truth()["time_s"]) // len(frame)
    assert np.diff(frame.time_s) == pytest.approx(np.diff(truth()["time_s"][::every]), rel=1e-6)
    for channel, values in frame.channels.items():
        true = truth()[channel][::every][: len(frame)]
        assert np.std(values - true) < 0.01 * np.std(true) + 1e-12, channel
    inertia = machine.model.inertia_kg_m2
    assert abs(inertia.value / DIAGNOSIS.inertia_kg_m2 - 1.0) < 0.1


def test_what_no_recording_tells_is_left_out_and_asked_for(tmp_path: Path) -> None:
    t = truth()
    table = {"t_s": t["time_s"], "x_mm": 1e3 * t["table_position_m"], "i_A": t["torque_command_nm"]}
    path, out = write(tmp_path / "r.csv", table), tmp_path / "machine.toml"
    text = adopt([path], out).words
    assert "--lead" in text and "--torque-constant" in text
    document = tomllib.loads(out.read_text("utf-8"))
    assert "lead_m" not in document["axis"] and "torque_command_nm" not in document["columns"]
    assert "inertia_kg_m2" not in document["model"]
    answers = {
        "Travel": LEAD_MM,
        "Torque": 2.0,
        "Dynamic": 7450.0,
        "Preload": None,
        "Stiffness": None,
        "Mass": 23.5,
    }
    asked: list[str] = []

    def ask(question: Any) -> float | None:
        asked.append(question.words.split()[0])
        return answers[asked[-1]]

    adopt([path], out, ask=ask)
    assert sorted(asked) == sorted(answers)
    machine = load_machine(out)
    assert machine.model.table_mass_kg is not None and machine.model.table_mass_kg.value == 23.5
    assert machine.axis.dynamic_load_rating_n == 7450.0
    assert machine.model.preload_n is None
    assert machine.model.inertia_kg_m2.value == pytest.approx(
        2.0 * DIAGNOSIS.inertia_kg_m2, rel=0.1
    )


ROUNDED: dict[str, Callable[[Columns], Any]] = {
    "4 digits": lambda values: np.round(values, 4),
    "5 digits": lambda values: np.round(values, 5),
    "7 significant digits": lambda values: [float(f"{value:.7g}") for value in values],
    "single precision": lambda values: np.float64(np.float32(values)),
    "double precision": np.asarray,
}


@pytest.mark.parametrize("form", ROUNDED)
def test_a_table_made_of_the_motors_angle_is_no_second_encoder(form: str, tmp_path: Path) -> None:
    columns = german()
    made = ROUNDED[form](columns["Motorwinkel [°]"] / 360.0 * LEAD_MM)
    columns["Motorwinkel [°]"] = ROUNDED[form](columns["Motorwinkel [°]"])
    columns["Tisch Lage [mm]"] = made
    path, out = write(tmp_path / "r.csv", columns), tmp_path / "machine.toml"
    assert "no second encoder" in adopt([path], out).words
    machine = load_machine(out)
    assert "table_position_m" not in machine.columns
    assert machine.axis.lead_m == pytest.approx(DIAGNOSIS.lead_m, rel=1e-3)


def test_a_wild_value_does_not_hide_what_was_computed(tmp_path: Path) -> None:
    columns = german()
    columns["Tisch Lage [mm]"] = np.round(columns["Motorwinkel [°]"] / 360.0 * LEAD_MM, 4)
    columns["Tisch Lage [mm]"][4000] = 1e6
    path, out = write(tmp_path / "r.csv", columns), tmp_path / "machine.toml"
    adopt([path], out)
    assert "table_position_m" not in load_machine(out).columns


@pytest.mark.parametrize("form", [form for form in ROUNDED if form != "4 digits"])
def test_a_linear_encoder_is_kept_in_whatever_digits(form: str, tmp_path: Path) -> None:
    columns = german()
    for name in ("Motorwinkel [°]", "Tisch Lage [mm]"):
        columns[name] = ROUNDED[form](columns[name])
    path, out = write(tmp_path / "r.csv", columns), tmp_path / "machine.toml"
    adopt([path], out)
    assert "table_position_m" in load_machine(out).columns


def test_a_current_without_a_sign_gets_that_of_the_direction(tmp_path: Path) -> None:
    t = truth()
    columns = {
        "t_s": t["time_s"],
        "set_point_mm": 1e3 * t["position_setpoint_m"],
        "x_mm": 1e3 * t["table_position_m"],
        "supply_current_A": np.abs(t["torque_command_nm"]),
    }
    path, out = write(tmp_path / "r.csv", columns), tmp_path / "machine.toml"
    text = adopt([path], out, known=Known(DIAGNOSIS.lead_m, 1.0)).words
    assert "has no sign" in text
    torque = read_recording(load_machine(out), path).channels["torque_command_nm"]
    speed = np.gradient(t["position_setpoint_m"], t["time_s"])
    steady = (np.abs(speed) > 0.5 * np.abs(speed).max()) & np.isfinite(torque)
    assert np.mean(np.sign(torque[steady]) == np.sign(speed[steady])) > 0.95


def test_several_axes_are_refused_with_their_list(tmp_path: Path) -> None:
    columns = industrial_edge() | {"ENC1_POS|5": truth()["time_s"][::2]}
    path = write(tmp_path / "r.csv", columns)
    with pytest.raises(TraceError, match=r"axes there are: 3, 5; .*--axis-number"):
        adopt([path], tmp_path / "m.toml")
    adopt([path], tmp_path / "m.toml", axis_number=3, known=Known(DIAGNOSIS.lead_m))
    assert load_machine(tmp_path / "m.toml").axis.number == 3


def test_a_clock_that_starts_anew_is_said_aloud(tmp_path: Path) -> None:
    columns = german()
    time_ms = columns["Zeit [ms]"]
    columns["Zeit [ms]"] = np.where(time_ms < 6000.0, time_ms, time_ms - 6000.0)
    path = write(tmp_path / "r.csv", columns)
    assert "starts anew 1 times" in adopt([path], tmp_path / "m.toml").words
