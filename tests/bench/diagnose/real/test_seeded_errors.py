"""Errors that are added to recordings of real machines, and how the answers to them are counted."""

import json
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main

from ... import real_machines
from ...real_machines import DATA
from ..cases import BenchError
from .seeded_errors import (
    KNOWN,
    MAGNITUDES,
    OPEN,
    Recording,
    SeededCase,
    SeededRow,
    figures_of,
    motion_of,
    plan,
    recordings,
    run_case,
    with_error,
)

RATE_HZ, SWING_RAD, TURNS_HZ = 500.0, 40.0, 0.25


def swinging() -> Recording:
    """A motor that swings for 20 s, with 0.2 N m of dry friction."""
    time_s = np.arange(0.0, 20.0, 1.0 / RATE_HZ)
    angle = SWING_RAD * np.sin(2.0 * np.pi * TURNS_HZ * time_s)
    torque = 0.2 * np.sign(np.cos(2.0 * np.pi * TURNS_HZ * time_s))
    columns = {"time_s": time_s, "torque_command_nm": torque, "motor_angle_rad": angle}
    return Recording("swing", "", columns, None, (), frozenset(), frozenset(KNOWN))


def test_motion_follows_the_recorded_angle() -> None:
    motion = motion_of(swinging())
    phase = 2.0 * np.pi * TURNS_HZ * motion.time_s
    inside = slice(20, -20)
    assert motion.speed[inside] == pytest.approx(np.cos(phase)[inside], abs=0.01)
    assert motion.acceleration[inside] == pytest.approx(-np.sin(phase)[inside], abs=0.02)
    assert float(np.ptp(motion.place)) == pytest.approx(1.0)


@pytest.mark.parametrize("error", [*KNOWN, *OPEN])
@pytest.mark.parametrize("magnitude", MAGNITUDES)
def test_an_error_is_as_large_as_it_says(error: str, magnitude: str) -> None:
    recording = swinging()
    columns = with_error(recording, SeededCase("swing", error, magnitude), seed=4)
    added = columns["torque_command_nm"] - recording.columns["torque_command_nm"]
    assert float(np.abs(added).max()) == pytest.approx(0.2 * MAGNITUDES[magnitude], rel=0.1)
    assert columns["motor_angle_rad"] is recording.columns["motor_angle_rad"]


def test_dry_friction_turns_with_the_motion() -> None:
    recording = swinging()
    columns = with_error(recording, SeededCase("swing", "drag_error", "large"), seed=4)
    added = columns["torque_command_nm"] - recording.columns["torque_command_nm"]
    way = motion_of(recording).way
    assert abs(float(added @ way)) == pytest.approx(float(np.abs(added).sum()))


def test_each_recording_is_asked_as_it_is_and_with_all_that_it_can_show() -> None:
    cases = plan([swinging()])
    assert cases[0] == SeededCase("swing", "", "")
    assert len(cases) == 1 + len(KNOWN) * len(MAGNITUDES)
    assert len(set(cases)) == len(cases)


def test_answers_are_counted_by_kind() -> None:
    def row(
        error: str, verdict: str, effects: tuple[tuple[str, float], ...], right: bool
    ) -> SeededRow:
        return SeededRow(SeededCase("swing", error, "large"), verdict, effects, {}, right)

    rows = [
        row("drag_error", "explained", (("drag_error", 0.95),), True),
        row("stribeck", "explained", (("backlash", 0.97),), False),
        row("stribeck", "no_gap", (), False),
        row("hum", "ambiguous", (("external_force", 0.6),), False),
        row("droop", "unknown", (("saturation", 0.9),), False),
        SeededRow(SeededCase("swing", "", ""), "no_gap", (), {}, True),
    ]
    figures = {
        each.name: (round(each.reached * each.count), each.count) for each in figures_of(rows)
    }
    assert figures["large error of the library: named first"] == (1, 3)
    assert figures["an error is named, but a wrong one, above .5"] == (1, 3)
    assert figures["error that no entry has: unknown, or none above .5"] == (1, 2)
    assert figures["as it is: no_gap"] == (1, 1)
    assert figures["first name above .9 is right"] == (1, 2)


def test_without_recordings_there_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BenchError, match="no recording"):
        recordings(tmp_path)
    monkeypatch.setattr(real_machines, "DATA", tmp_path)
    assert main(["bench", "diagnose", "--only", "real-machines"]) == 2
    assert (
        capsys.readouterr().err.strip().endswith(f"no recording of emps or cranfield in {tmp_path}")
    )


@pytest.mark.slow
@pytest.mark.parametrize("error", ["", "drag_error", "load_offset", "hum"])
def test_a_real_axis_with_an_error_is_named_rightly(error: str) -> None:
    if not (DATA / "emps").is_dir():
        pytest.skip("the recordings of emps are not here")
    first = recordings(DATA)[0]
    row = run_case(first, SeededCase(first.name, error, "large" if error else ""), seed=9)
    if error in OPEN:
        assert row.verdict == "unknown" or row.effects[0][1] <= 0.5
    else:
        assert row.right, json.dumps(row.effects)
