"""The diagnosis on a second plant: its commands are run, its answers counted, its rows thinned."""

import json
from pathlib import Path
from typing import Any

import pytest

from edge_service.cli.entry import main

from ..estimator.plants.second_plant import BESIDE, SecondPlantError, run_command
from .second_plant import (
    figures_of,
    has_diagnosis_plant,
    run_diagnosis_plant,
    slow_figures_of,
    thin,
)

MAKE = """
import json, pathlib, sys
out = pathlib.Path(sys.argv[1])
kinds = {"a": ("single", ["drag_error"]), "b": ("control", []), "c": ("single", ["delay"])}
cases = {}
for name, (kind, effects) in kinds.items():
    (out / name / "traces").mkdir(parents=True)
    (out / name / "hidden").mkdir()
    (out / name / "machine.toml").write_text("[axis]")
    rows = "".join(f"{k},{k}\\n" for k in range(100))
    (out / name / "traces" / "t.csv").write_text("time_s,motor_angle_rad\\n" + rows)
    cases[name] = {"kind": kind, "effects": effects, "snr": dict.fromkeys(effects, 3.0)}
(out / "answers.json").write_text(json.dumps({"cases": cases}))
"""
SCORE = """
import json, pathlib, sys
out = pathlib.Path(sys.argv[1])
rows = len((out / "a" / "traces" / "t.csv").read_text().splitlines()) - 1
cases = []
for name, case in json.loads((out / "answers.json").read_text())["cases"].items():
    named = [{"name": n, "probability": 0.9} for n in case["effects"]]
    verdict = "explained" if named else "no_gap"
    if rows < 10 and named:
        verdict, named = "unknown", []
    cases.append({**case, "d": {"verdict": verdict, "effects": named}})
metrics = {"hold-out": {"median_share_of_achievable": 0.5, "share_n": 2,
                        "coverage": {"rate": 0.5, "n": 2}},
           "probability": {"ece": 0.1, "n": 2}, "run": {"cpu_median": 1.0}}
pathlib.Path(sys.argv[sys.argv.index("--json") + 1]).write_text(
    json.dumps({"metrics": metrics, "cases": cases}))
"""
METRICS: dict[str, Any] = {
    "hold-out": {
        "median_share_of_achievable": 0.9,
        "share_n": 3,
        "coverage": {"rate": 2.0 / 3.0, "n": 3},
    },
    "probability": {"ece": 0.04, "n": 3},
    "run": {"cpu_median": 7.0},
}


def case(kind: str, effects: list[str], verdict: str, **said: float) -> dict[str, Any]:
    named = [{"name": name, "probability": p} for name, p in said.items()]
    answer = {"verdict": verdict, "effects": named}
    return {"kind": kind, "effects": effects, "snr": dict.fromkeys(effects, 1.0), "d": answer}


def reached(cases: list[dict[str, Any]], name: str) -> tuple[float, int]:
    return next(
        (each.reached, each.count)
        for each in figures_of(cases, METRICS)
        if each.name.startswith(name)
    )


def test_its_commands_are_run_and_shown_as_a_table(tmp_path: Path) -> None:
    (tmp_path / "make.py").write_text(MAKE)
    (tmp_path / "score.py").write_text(SCORE)
    said: list[str] = []
    text = run_diagnosis_plant(tmp_path, 7, True, None, said.append)
    assert "seed 7" in text
    assert "| singles, clear: named first | >= 97 % | 2 of 2 |" in text
    assert "| healthy: no_gap | >= 97 % | 1 of 1 |" in text
    assert "| 250 Hz: friction error named first | all | 1 of 1 |" in text
    assert "| 50 Hz: friction error named first | all | 0 of 1 |" in text
    assert "seed 7" in said[0]


def test_a_command_that_fails_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "make.py").write_text("raise SystemExit('no room')")
    (tmp_path / "score.py").write_text(SCORE)
    with pytest.raises(SecondPlantError, match=r"make\.py ended with 1: no room"):
        run_diagnosis_plant(tmp_path, 7, True, None)


def test_a_name_without_a_verdict_is_no_hit() -> None:
    right = case("single", ["delay"], "explained", delay=0.9)
    doubted = case("single", ["delay"], "unknown", delay=0.9)
    crashed = {"kind": "single", "effects": ["delay"], "snr": {"delay": 5.0}}
    assert reached([right, doubted, crashed], "singles, all") == (pytest.approx(1.0 / 3.0), 3)
    assert reached([right, doubted, crashed], "singles, clear") == (0.0, 1)
    both = case("double", ["delay", "backlash"], "explained", backlash=0.9, delay=0.8)
    late = case("double", ["delay", "backlash"], "explained", backlash=0.9, stribeck=0.8, delay=0.7)
    assert reached([both, late], "doubles") == (0.5, 2)


def test_what_the_library_lacks_must_not_be_named_surely() -> None:
    cases = [
        case("open", ["windage"], "unknown", stribeck=0.4),
        case("open", ["windage"], "unknown", stribeck=0.8),
        case("open", ["windage"], "explained", stribeck=0.4),
        case("open", ["windage"], "no_gap"),
    ]
    assert reached(cases, "cause that no entry has") == (0.25, 4)


def test_a_healthy_axis_is_quiet_or_accused() -> None:
    cases = [
        case("control", [], "no_gap"),
        case("control", [], "unknown"),
        case("control", [], "explained", drag_error=0.9),
    ]
    assert reached(cases, "healthy: no_gap") == (pytest.approx(1.0 / 3.0), 3)
    assert reached(cases, "healthy: falsely") == (pytest.approx(1.0 / 3.0), 3)
    slow = slow_figures_of(cases, "25 Hz")
    assert [(each.reached, each.count) for each in slow] == [(0.0, 0), (pytest.approx(1 / 3), 3)]


def test_thinned_recordings_are_of_healthy_axes_and_friction(tmp_path: Path) -> None:
    whole, out = tmp_path / "whole", tmp_path / "thin"
    (tmp_path / "make.py").write_text(MAKE)
    assert not has_diagnosis_plant(tmp_path)
    run_command([str(tmp_path / "make.py"), str(whole)], lambda _line: None)
    thin(whole, out, 10)
    assert sorted(each.name for each in out.iterdir()) == ["a", "answers.json", "b"]
    lines = (out / "a" / "traces" / "t.csv").read_text().splitlines()
    assert lines == ["time_s,motor_angle_rad", *(f"{k},{k}" for k in range(0, 100, 10))]
    assert set(json.loads((out / "answers.json").read_text())["cases"]) == {"a", "b"}


@pytest.mark.slow
@pytest.mark.skipif(not has_diagnosis_plant(BESIDE), reason=f"no second plant in {BESIDE}")
def test_the_installed_command_is_scored_on_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "diagnose", "--second-plant", "--quick", "--seed", "11"]) == 0
    table = capsys.readouterr().out
    assert "| singles, all strengths: named first |" in table
    assert "| 50 Hz: healthy no_gap | all |" in table
