"""The command's files, what it says of bad input, and what it takes from `doctor`."""

import json
from pathlib import Path

import pytest

from edge_service.checks.finding import Finding
from edge_service.checks.finding import Verdict as Check
from edge_service.cli.entry import main
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Verdict
from edge_service.models.effects.registry import effects
from edge_service.models.machine import Machine
from edge_service.offline.diagnosis.diagnose import beside_doubts, doubts

from .conftest import diagnosed, frame_of, recorded, runs, session_of


@pytest.mark.slow
def test_three_files_and_a_loop_that_closes(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = str(recorded(("drag_error", "backlash"), 3).write_csv(tmp_path / "a.csv"))
    document, out = diagnosed(machine_file, tmp_path, trace), tmp_path / "out"
    assert (document["schema"], document["verdict"]) == ("diagnosis/1", "explained")
    assert {each["name"] for each in document["effects"]} == {"drag_error", "backlash"}
    for each in document["effects"]:
        assert each["shrink"]["low"] <= each["shrink"]["estimate"] <= each["shrink"]["high"]
        assert each["class"][0] == each["name"]
    page = (out / "report.html").read_text()
    assert "drag error" in page.lower()
    assert 'src="http' not in page
    assert "<script" not in page
    assert "<link" not in page
    capsys.readouterr()
    augmented = str(out / "augmented.toml")
    assert main(["gap", "--machine", augmented, trace, "--json"]) == 0
    gap = json.loads(capsys.readouterr().out)
    for name, rms in gap.items():
        assert rms == pytest.approx(document["gap"][name]["after"], rel=0.02)
    simulated = ["--duration", "1", "--out", str(tmp_path / "s.csv")]
    assert main(["simulate", "--machine", augmented, *simulated]) == 0


def test_bad_data_is_a_verdict_with_a_status_of_its_own(
    machine_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trace = tmp_path / "a.csv"
    rows = "".join(f"{k / 1000},0.1,1.0\n" for k in range(3000))
    trace.write_text("time_s,torque_command_nm,motor_angle_rad\n" + rows)
    document = diagnosed(machine_file, tmp_path, str(trace))
    assert capsys.readouterr().err.count("\n") == 1
    assert document["verdict"] == "bad_data"
    assert document["reasons"]
    written = {each.name for each in (tmp_path / "out").iterdir()}
    assert written == {"diagnosis.json", "augmented.toml", "report.html"}


def test_a_run_that_fails_leaves_no_older_answer(machine_file: Path, tmp_path: Path) -> None:
    trace = str(recorded((), 3).write_csv(tmp_path / "a.csv"))
    out = tmp_path / "out"
    given = ["diagnose", "--machine", str(machine_file), "--out", str(out)]
    assert main([*given, trace]) == 0
    assert (out / "report.html").exists()
    (out / "notes.txt").write_text("mine")
    (tmp_path / "b.csv").write_text("nothing")
    assert main([*given, str(tmp_path / "b.csv")]) == 2
    assert [each.name for each in out.iterdir()] == ["notes.txt"]
    assert main(["diagnose", str(tmp_path / "b.csv"), "--out", str(tmp_path / "new")]) == 2
    assert not (tmp_path / "new").exists()


LIBRARY = tuple(effects().values())
LAG = Finding("encoder_lag", Check.DOUBTFUL, "linear encoder lags rotary by 0.45 ms")


@pytest.mark.slow
def test_an_encoder_that_lags_is_found_by_both(machine: Machine) -> None:
    frame = frame_of(recorded(("timestamp_skew",), 3, 8.0))
    (doubted,) = doubts(machine, runs(machine, frame))
    assert doubted.name == "encoder_lag"
    found = diagnose_session(session_of(machine, frame), machine)
    assert [each.name for each in found.effects] == ["timestamp_skew"]
    assert beside_doubts(found, [doubted], LIBRARY) is found


@pytest.mark.parametrize("causes", [(), ("drag_error",), ("compliance",)])
def test_encoders_in_step_are_not_doubted(machine: Machine, causes: tuple[str, ...]) -> None:
    assert doubts(machine, runs(machine, frame_of(recorded(causes, 3)))) == []


@pytest.mark.slow
def test_a_lag_that_the_causes_lack_is_tied_with_what_it_passes_for(machine: Machine) -> None:
    found = diagnose_session(session_of(machine, frame_of(recorded(("compliance",), 3))), machine)
    assert found.verdict is Verdict.EXPLAINED
    unsure = beside_doubts(found, [LAG], LIBRARY)
    assert unsure.verdict is Verdict.AMBIGUOUS
    (compliance,) = unsure.effects
    assert compliance.tied == ("compliance", "timestamp_skew")
    assert compliance.probability <= 0.5
    assert beside_doubts(found, [], LIBRARY) is found
