"""Dates of wearing screws against what came, and why a linear model would not fit the bench."""

import json
import math
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from edge_service.cli.entry import main
from edge_service.diagnose.session.session import TRANSMISSION_GAP
from edge_service.messages.samples import SampleFrame
from edge_service.models.effects.registry import get_effect
from edge_service.models.effects.signature import transmission_signature
from edge_service.models.machine import Machine
from edge_service.offline.reproduce import puzzle
from edge_service.offline.reproduce.wear import first_crossing_h, read_wear_test, study

REAL = Path(__file__).parents[3] / "shared/data/xjtu_wear/lower_screw_drag_nm.txt"


def test_drag_torques_alone_are_a_test_whose_speed_rises(tmp_path: Path) -> None:
    file = tmp_path / "drag.txt"
    file.write_text("0.5\n" * 10)
    time_h, distance_m, _ = read_wear_test(file)
    np.testing.assert_allclose(time_h, 35.0 * np.arange(10))
    by_hand = 60.0 * 0.008 * np.array([0.0, 300.0 * 35.0, 300.0 * 140.0, 800.0 * 140.0])
    np.testing.assert_allclose(distance_m[[0, 1, 4, 8]], by_hand)


def test_a_wear_test_may_state_its_times_and_speeds(tmp_path: Path) -> None:
    file = tmp_path / "drag.csv"
    file.write_text("time_h,speed_rpm,drag_torque_nm\n0,100,0.5\n10,100,0.4\n15,200,0.3\n")
    time_h, distance_m, drag_nm = read_wear_test(file)
    assert time_h.tolist() == [0.0, 10.0, 15.0]
    np.testing.assert_allclose(distance_m, 0.48 * np.array([0.0, 1000.0, 2000.0]))
    assert drag_nm.tolist() == [0.5, 0.4, 0.3]


def test_a_crossing_lies_straight_between_readings() -> None:
    time_h, percent = 10.0 * np.arange(6), np.array([100.0, 95.0, 85.0, 95.0, 85.0, 80.0])
    assert first_crossing_h(time_h, percent, 90.0) == pytest.approx(15.0)
    assert first_crossing_h(time_h, percent, 50.0) == math.inf


@pytest.mark.skipif(not REAL.exists(), reason=f"needs {REAL}, a real screw's wear")
def test_a_real_screw_crosses_within_the_bands() -> None:
    found = study(*read_wear_test(REAL))
    assert (found.held, found.stated) == (27, 28)
    assert {limit for stage in found.stages for limit in stage.dates} == {90.0, 85.0, 80.0}


def test_the_command_writes_table_json_and_picture(tmp_path: Path, capsys) -> None:
    percent = 100.0 - 2.0 * np.arange(14) + 0.3 * np.random.default_rng(4).standard_normal(14)
    file = tmp_path / "drag.txt"
    file.write_text("".join(f"{0.005 * each:.4f}\r\n" for each in percent))
    out = tmp_path / "out"
    assert main(["reproduce", "wear", str(file), "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "90% bands held what came" in text
    page = (out / "report.html").read_text()
    assert "bands held what came" in page
    assert "<svg" in page
    assert main(["reproduce", "wear", str(file), "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert len(found["stages"]) == 14
    assert found["crossings_h"]["90.0"] == pytest.approx(175.0, abs=20.0)


def test_a_screw_that_reaches_no_limit_is_told_so(tmp_path: Path, capsys) -> None:
    file = tmp_path / "drag.txt"
    file.write_text("0.5\n" * 9)
    assert main(["reproduce", "wear", str(file), "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "90 % of fresh: not reached" in text
    assert "nan" not in text


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0.5\nx\n", "line 2: 'x'"),
        ("0.5\n", "2 lines"),
        ("0.5\n-1\n", "above 0"),
        ("time_h,drag_torque_nm\n0,1\n", "expected the columns time_h, speed_rpm"),
        ("time_h,speed_rpm,drag_torque_nm\n0,1,1\n0,1,1\n", "times that rise"),
    ],
)
def test_what_is_no_wear_test_is_one_line(tmp_path: Path, capsys, text: str, words: str) -> None:
    file = tmp_path / "drag.txt"
    file.write_text(text)
    assert main(["reproduce", "wear", str(file)]) == 2
    assert words in capsys.readouterr().err
    assert main(["reproduce", "wear"]) == 2
    assert "FILE" in capsys.readouterr().err


@cache
def situation() -> tuple[list[SampleFrame], Machine]:
    bench = puzzle.bench_machine()
    frames = puzzle.recorded(bench)
    return frames, puzzle.linear_model(bench, frames)


@pytest.mark.slow
def test_no_inertia_and_viscous_friction_near_the_fitted_ones_fit_better() -> None:
    frames, linear = situation()
    fitted = puzzle.fitted(linear, frames)
    best = puzzle.gap_of(fitted, frames)["torque_nm"]
    assert best < puzzle.gap_of(linear, frames)["torque_nm"]
    for key in ("inertia_kg_m2", "viscous_nm_s_per_rad"):
        for factor in (0.97, 1.03):
            quantity = getattr(fitted.model, key)
            near = quantity.model_copy(update={"value": factor * quantity.value})
            model = fitted.model.model_copy(update={key: near})
            other = fitted.model_copy(update={"model": model})
            assert puzzle.gap_of(other, frames)["torque_nm"] > best


def test_what_is_left_between_the_encoders_is_the_falling_stiffness() -> None:
    frames, linear = situation()
    session = puzzle.session_of(linear, frames)
    effect = get_effect("compliance")
    curves = [
        partial(transmission_signature, effect, effect.complete({name: 1e-8}))
        for name in ("level_m_per_n", "slope_per_n")
    ]
    columns = np.column_stack(
        [
            session.column(TRANSMISSION_GAP, partial(curve, baseline=session.baseline))
            for curve in curves
        ]
    )
    rows = session.channels[TRANSMISSION_GAP]
    beta = np.linalg.lstsq(columns, rows.gap, rcond=None)[0]
    left = float(np.sqrt(np.mean((rows.gap - columns @ beta) ** 2)))
    assert beta[1] > 0.0  # it gives more, further from the fixed bearing
    assert left < 0.5 * rows.rms


def test_the_picture_has_a_bar_for_each_step() -> None:
    before = {"torque_nm": 0.2, "transmission_m": 1e-6}
    step = puzzle.Step("drag_error", {"torque_nm": 0.1, "transmission_m": 1e-6})
    found = puzzle.Puzzle(before, before, before, ("explained",), (step,))
    figure = puzzle.draw_puzzle(found)
    labels = [each.get_text() for each in figure.axes[0].get_yticklabels()]
    assert labels == ["linear model", "(fitted)", "+ drag error"]


@pytest.mark.slow
def test_the_diagnosis_says_that_it_is_dry_friction() -> None:
    found = puzzle.solve()
    named = {step.effect for step in found.steps}
    assert {"stribeck", "compliance"} <= named
    assert named <= {"stribeck", "compliance", "warmup", "drag_error"}  # what the bench has
    before = found.before["torque_nm"]
    first = next(step for step in found.steps if step.gap["torque_nm"] < 0.9 * before)
    assert {"stribeck", "drag_error", "warmup"} & {first.effect}  # dry, all three
    assert first.gap["torque_nm"] < 0.5 * before
    assert found.steps[-1].gap["transmission_m"] < 0.25 * found.before["transmission_m"]
    assert found.steps[-1].gap["torque_nm"] < 0.25 * found.before["torque_nm"]
    assert found.fitted["torque_nm"] > 0.7 * found.before["torque_nm"]
