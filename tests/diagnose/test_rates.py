"""A slow recording of an axis has the answer of the fast one, as far as it can."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.messages.samples import Floats

from ..bench.real_machines import written
from .conftest import DURATION_S, diagnosed, recorded

FASTER_HZ = 2000.0
Columns = Mapping[str, Floats]


def trace(folder: Path, causes: tuple[str, ...], every: int, seed: int = 3) -> str:
    """A minute and a half of a foreign axis, each so-many-th row."""
    recording = recorded(causes, seed, duration_s=2.5 * DURATION_S)
    return written(folder / "a.csv", {n: each[::every] for n, each in recording.columns.items()})


@pytest.mark.slow
@pytest.mark.parametrize("every", [2, 4, 10, 20, 40])
@pytest.mark.parametrize("cause", ["drag_error", "viscous_error"])
def test_a_friction_error_is_named_at_any_rate(
    machine_file: Path, tmp_path: Path, cause: str, every: int
) -> None:
    found = diagnosed(machine_file, tmp_path, trace(tmp_path, (cause,), every))
    assert found["verdict"] in ("explained", "ambiguous")
    assert found["effects"][0]["name"] == cause


@pytest.mark.slow
@pytest.mark.parametrize("every", [4, 10, 40])
def test_a_healthy_axis_stays_quiet_at_any_rate(
    machine_file: Path, tmp_path: Path, every: int
) -> None:
    found = diagnosed(machine_file, tmp_path, trace(tmp_path, (), every, seed=5))
    assert found["verdict"] == "no_gap"


def test_what_a_slow_recording_cannot_show_is_said(machine_file: Path, tmp_path: Path) -> None:
    found = diagnosed(machine_file, tmp_path, trace(tmp_path, (), 20))
    assert {"delay", "presliding", "torque_ripple"} <= set(found["not_judged"])
    assert "sampled too slowly" in found["not_judged_reasons"]["delay"]
    assert set(found["not_judged"]) == set(found["not_judged_reasons"])


def test_below_twenty_a_second_nothing_is_said(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    slow = trace(tmp_path, (), 100)
    assert main(["diagnose", "--machine", str(machine_file), slow, "--out", str(out)]) == 3
    assert "10 samples/s, expected" in capsys.readouterr().err


def interpolated(columns: Columns) -> list[Columns]:
    time_s = columns["time_s"]
    fine = np.arange(time_s[0], time_s[-1], 1.0 / FASTER_HZ)
    return [{name: np.interp(fine, time_s, values) for name, values in columns.items()}]


def halves(columns: Columns) -> list[Columns]:
    half = len(columns["time_s"]) // 2
    parts = (slice(None, half), slice(half, None))
    return [{name: values[rows] for name, values in columns.items()} for rows in parts]


@pytest.mark.slow
@pytest.mark.parametrize("told", [interpolated, halves])
def test_the_same_motion_told_otherwise_has_the_same_answer(
    machine_file: Path, tmp_path: Path, told: Callable[[Columns], list[Columns]]
) -> None:
    columns = dict(recorded(("drag_error",), seed=3).columns)
    parts = [written(tmp_path / f"{k}.csv", each) for k, each in enumerate(told(columns))]
    once = diagnosed(machine_file, tmp_path, written(tmp_path / "a.csv", columns))
    again = diagnosed(machine_file, tmp_path, *parts)
    assert once["effects"][0]["name"] == again["effects"][0]["name"] == "drag_error"
    value, other = (each["effects"][0]["parameters"]["change_nm"] for each in (once, again))
    assert value["low"] < other["value"] < value["high"]
