"""Machines that others measured: `adopt` and the command after it tell the truth, or why not."""

import contextlib
import csv
import io
import json
import math
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest

from edge_service.checks.columns.guess import Known
from edge_service.cli.entry import main
from edge_service.config import load_machine
from edge_service.messages.samples import Floats
from edge_service.offline.adopt import adopt

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="no recordings beside the checkout")


def said(*arguments: object, status: int = 0) -> str:
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard), contextlib.redirect_stderr(heard):
        ended = main([str(each) for each in arguments])
    assert ended == status, heard.getvalue()
    return heard.getvalue()


def adopted(trace: Path, folder: Path, *options: object) -> Path:
    out = folder / f"{trace.stem}.toml"
    said("adopt", trace, "--out", out, *options)
    return out


def inertia_of(folder: Path) -> dict[str, float]:
    """Figure of a fingerprint: value, low, high in kg m2."""
    written = json.loads((folder / "fingerprint.json").read_text())
    found: dict[str, float] = written["sections"]["inertia"]["figures"]["inertia_kg_m2"]
    return found


def plain_inertia(
    position: Floats, torque: Floats, step_s: float, width: int
) -> tuple[float, float]:
    """Inertia by least squares on smoothed differences, with its standard deviation."""
    even = np.ones(width) / width
    position, torque = (np.convolve(each, even, mode="valid") for each in (position, torque))
    speed = np.gradient(position, step_s)
    moving = np.abs(speed) > 0.05 * np.abs(speed).max()
    terms = (np.gradient(speed, step_s), speed, np.sign(speed), np.ones(len(speed)))
    design, target = np.column_stack(terms)[moving], torque[moving]
    fit = np.linalg.lstsq(design, target, rcond=None)[0]
    variance = np.mean((target - design @ fit) ** 2) * width * np.linalg.pinv(design.T @ design)
    return abs(float(fit[0])), float(np.sqrt(variance[0, 0]))


def column(path: Path, name: str) -> Floats:
    with path.open() as file:
        return np.array([float(row[name]) for row in csv.DictReader(file)])


def columns_of(path: Path) -> dict[str, dict[str, object]]:
    found = tomllib.loads(path.read_text("utf-8"))["columns"]
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("name", ["normal", "lackLubrication1", "backlash1"])
def test_cranfield_reads_as_its_makers_describe_it(name: str, tmp_path: Path) -> None:
    out = tmp_path / "m.toml"
    text = adopt([DATA / "cranfield" / f"{name}.csv"], out, known=Known(0.005, 1.0)).words
    assert "has no sign" in text and "starts anew" in text and "inertia: no" in text
    found = columns_of(out)
    assert found["table_position_m"] == {
        "column": "set_point",
        "scale": 0.001,
        "minus": "position_error",
    }
    assert found["torque_command_nm"]["direction"] == "set_point"
    assert found["time_s"] == {"column": "time", "scale": 1.0}


def test_the_mills_rows_are_a_tenth_of_a_second_apart(tmp_path: Path) -> None:
    path = DATA / "smart_cnc_mill" / "experiment_06.csv"
    for number, name in ((1, "X1"), (2, "Y1")):
        out = tmp_path / f"{name}.toml"
        adopt([path], out, axis_number=number, known=Known(0.01, 0.06))
        found = columns_of(out)
        assert found["time_s"] == {"column": "#row", "scale": 0.1}
        assert found["table_position_m"] == {"column": f"{name}_ActualPosition", "scale": 0.001}
        assert load_machine(out).axis.name == name


def test_a_torque_with_a_borrowed_sign_is_refused_with_what_would_serve(tmp_path: Path) -> None:
    """A minute of the recording, so that adopt reads it quickly."""
    trace = tmp_path / "short.csv"
    lines = (DATA / "cranfield" / "backlash1.csv").read_text().splitlines(keepends=True)
    trace.write_text("".join(lines[:4000]))
    machine = adopted(trace, tmp_path, "--lead", 5, "--torque-constant", 1)
    for command in ("fingerprint", "commission", "estimate", "diagnose"):
        status = 3 if command == "diagnose" else 2
        out = tmp_path / command
        text = said(command, "--machine", machine, trace, "--out", out, status=status)
        assert "sign of the direction" in text
        assert "edge-service drift" in text


def test_emps_gives_its_published_mass_and_friction_and_no_percent(tmp_path: Path) -> None:
    trace, ratio = DATA / "emps" / "emps_estimation.csv", 0.0025 / (2.0 * math.pi)
    machine = adopted(trace, tmp_path, "--lead", 2.5, "--torque-constant", 35.15065 * ratio)
    model = load_machine(machine).model
    assert model.inertia_kg_m2.value / ratio**2 == pytest.approx(95.1089, rel=0.02)
    assert model.preload_drag_nm is not None
    assert model.preload_drag_nm.value / ratio == pytest.approx(20.3935, rel=0.05)
    text = said("commission", "--machine", machine, trace, "--out", tmp_path / "c.toml")
    inertia, coulomb = (
        float(re.search(rf"{name} (\S+)", text)[1])  # type: ignore[index]
        for name in ("inertia", "Coulomb friction")
    )
    assert inertia / ratio**2 == pytest.approx(95.1089, rel=0.02)
    assert coulomb / ratio == pytest.approx(20.3935, rel=0.05)
    said("estimate", "--machine", machine, trace, "--out", tmp_path / "e.csv")
    with (tmp_path / "e.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["status"] == "estimated"]
    drags = np.array([float(row["drag_torque_nm"]) for row in rows])
    assert np.median(drags) / ratio == pytest.approx(20.3935, rel=0.05)
    assert {row["preload_percent"] for row in rows} == {""}


@pytest.mark.parametrize("number", [1, 2, 3])
def test_dmc_60_h_fingerprints_to_inertia_of_plain_regression(number: int, tmp_path: Path) -> None:
    trace, lead_m = DATA / "kit_dmc60h" / "excerpt.csv", 0.016
    machine = adopted(trace, tmp_path, "--lead", 16, "--axis-number", number)
    text = said("fingerprint", "--machine", machine, trace, "--out", tmp_path)
    angle = column(trace, f"ENC1_POS|{number}") * 2.0 * math.pi * 1e-3 / lead_m
    plain, _ = plain_inertia(angle, column(trace, f"TORQUE|{number}"), 0.002, 11)
    assert inertia_of(tmp_path)["value"] == pytest.approx(plain, rel=0.1)
    undetermined = [line for line in text.splitlines() if "undetermined" in line]
    assert len(undetermined) == 8
    assert all("record `edge-service motion" in line for line in undetermined)


@pytest.mark.parametrize(
    ("command", "status", "why"),
    [
        ("commission", 2, "s of steady motion: needs moves in both directions"),
        ("diagnose", 3, "the axis moves for 0.21 s, expected 2 s or more"),
        ("estimate", 0, "unestimated (learning: 0.1 of 1.0 s of steady motion seen)"),
    ],
)
def test_a_quarter_of_a_second_of_motion_is_said_to_be_too_little(
    command: str, status: int, why: str, tmp_path: Path
) -> None:
    trace = DATA / "kit_dmc60h" / "excerpt.csv"
    machine = adopted(trace, tmp_path, "--lead", 16, "--axis-number", 1)
    assert why in said(command, "--machine", machine, trace, "--out", tmp_path / "x", status=status)


@pytest.mark.parametrize("name", ["no-pp-sine-sweep-10mm-0.5Hz", "pp-square-wave-10mm-0.5Hz"])
def test_a_screw_actuator_shows_inertia_of_a_plain_regression(name: str, tmp_path: Path) -> None:
    trace = DATA / "screw_actuators" / f"LinA_{name}.txt"
    machine = adopted(trace, tmp_path, "--lead", 1, "--torque-constant", 0.0429)
    said("fingerprint", "--machine", machine, trace, "--out", tmp_path)
    samples = np.loadtxt(trace)
    angle, torque = 2.0 * math.pi * samples[:, 3], 0.0429e-3 * samples[:, 5]
    plain, sigma = plain_inertia(angle, torque, 0.01, 5)
    found = inertia_of(tmp_path)
    assert found["low"] - 2.0 * sigma <= plain <= found["high"] + 2.0 * sigma


def test_a_current_that_shows_neither_inertia_nor_friction_keeps_its_sign(tmp_path: Path) -> None:
    trace = DATA / "screw_actuators" / "LinA_no-load-square-wave-full-travel-0.5Hz.txt"
    options = ("--lead", 1, "--torque-constant", 0.0429)
    text = said("adopt", trace, "--out", tmp_path / "m.toml", *options)
    assert "neither inertia nor friction shows its sign" in text
    assert "friction and its change: no" in text


@pytest.mark.parametrize(
    "path", sorted((DATA / "screw_actuators").glob("*.txt")), ids=lambda p: p.stem
)
def test_the_current_of_a_screw_actuator_is_its_last_column(path: Path, tmp_path: Path) -> None:
    """Columns stand in the data's README: the targets swing like a current, and are none."""
    assert "'#6' moves like a current" in said("adopt", path, "--out", tmp_path / "m.toml")


def test_a_servo_tuning_is_passed_on_to_the_command_that_reads_it(tmp_path: Path) -> None:
    """Raw peaks at 41.5 and 59.1 Hz, table share .48, control's inertia .147: the data's README."""
    path = DATA / "sinumerik_ast" / "AST_AX7.xml"
    refusal = said("adopt", path, "--out", tmp_path / "m.toml", status=2)
    assert "servo tuning" in refusal
    assert "edge-service fingerprint" in refusal
    text = said("fingerprint", path, "--out", tmp_path)
    found = {
        name: float(re.search(rf"^Frequency response: {name} (\S+)", text, re.MULTILINE)[1])  # type: ignore[index]
        for name in ("antiresonance", "resonance", "table share", "response inertia")
    }
    assert found["antiresonance"] == pytest.approx(41.5, abs=1.6)
    assert found["resonance"] == pytest.approx(59.1, abs=1.9)
    assert found["table share"] == pytest.approx(0.48, abs=0.03)
    assert found["response inertia"] * 1e-4 == pytest.approx(0.147, rel=0.1)
    assert "the control states: total inertia 0.1468 kg m2" in text


def test_mills_friction_holds_a_plain_regression_and_its_rate_is_refused(tmp_path: Path) -> None:
    trace, constant = DATA / "smart_cnc_mill" / "experiment_06.csv", 0.06
    options = ("--axis-number", 1, "--lead", 10, "--torque-constant", constant)
    machine = adopted(trace, tmp_path, *options)
    said("fingerprint", "--machine", machine, trace, "--out", tmp_path)
    names = ("ActualAcceleration", "ActualVelocity", "CurrentFeedback")
    acceleration, speed, current = (column(trace, f"X1_{name}") for name in names)
    moving = np.abs(speed) > 0.5
    terms = (acceleration, speed, np.sign(speed), np.ones(len(speed)))
    plain = np.linalg.lstsq(np.column_stack(terms)[moving], current[moving], rcond=None)[0]
    sections = json.loads((tmp_path / "fingerprint.json").read_text())["sections"]
    friction = sections["inertia"]["figures"]["rigid_coulomb_nm"]
    assert friction["low"] <= constant * plain[2] <= friction["high"]
    assert sections["inertia"]["figures"]["inertia_kg_m2"]["value"] is None
    text = said("diagnose", "--machine", machine, trace, "--out", tmp_path / "d", status=3)
    assert "10 samples/s, expected 20 or more" in text


def test_figures_of_single_days_are_no_recording_but_a_history_of_wear(tmp_path: Path) -> None:
    path = DATA / "xjtu_wear" / "lower_screw_drag_nm.txt"
    refusal = said("adopt", path, "--out", tmp_path / "m.toml", status=2)
    assert "expected samples of an axis in motion" in refusal
    text = said("reproduce", "wear", path, "--out", tmp_path)
    drag = np.loadtxt(path)
    for percent in (90, 85, 80):
        k = int(np.argmax(drag < percent / 100.0 * drag[0]))
        share = (drag[k - 1] - percent / 100.0 * drag[0]) / (drag[k - 1] - drag[k])
        crossing_h = 35.0 * (k - 1 + share)
        told = re.search(rf"{percent} % of fresh: first reading below at (\d+) h", text)
        assert told is not None
        assert float(told[1]) == pytest.approx(crossing_h, abs=1.0)
    held = re.search(r"(\d+) of (\d+) 90% bands held what came", text)
    assert held is not None
    assert int(held[1]) >= 0.9 * int(held[2])
