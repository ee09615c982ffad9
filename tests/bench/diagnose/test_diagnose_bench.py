"""Small cases of the three benches of the diagnosis: what must hold whatever their numbers."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from edge_service.cli.entry import main
from edge_service.diagnose.result import SURE
from tests.bench.commands import bench

from ...hidden_effects.cases import HiddenCase
from .. import real_machines
from ..estimator.plants.second_plant import BESIDE
from ..real_machines import DATA
from .foreign_table import run_cases
from .second_plant import MAKE
from .seeded_errors import OPEN, SeededCase, recordings, run_case

HEALTHY = [HiddenCase((), 1.0, motion, 70 + k) for k, motion in enumerate(("full", "staircase"))]
SINGLES = [
    HiddenCase((cause,), 1.0, motion, 80 + k)
    for k, (cause, motion) in enumerate(
        [("position_friction", "staircase"), ("backlash", "production")]
    )
]
PAIRS = [
    HiddenCase(("load_offset", "encoder_eccentricity"), 1.0, "production", 90),
    HiddenCase(("drag_error", "timestamp_skew"), 1.0, "staircase", 91),
]
ODD = [
    HiddenCase((cause,), 1.0, "production", 100 + k)
    for k, cause in enumerate(("stuck_seal", "loose_fixture", "crosstalk"))
]
LEFT_OUT = [
    HiddenCase((cause,), 1.0, "staircase", 110 + k, (cause,))
    for k, cause in enumerate(("torque_ripple", "position_friction"))
]


@pytest.mark.slow
@pytest.mark.smoke
def test_a_healthy_axis_is_quiet_and_a_single_cause_leads() -> None:
    answers = run_cases([HEALTHY[1], SINGLES[0]], print)
    healthy, single = sorted(answers, key=lambda row: row.case.seed)
    assert (healthy.found.verdict, healthy.named) == ("no_gap", {})
    assert single.outcome == "named"


@pytest.mark.slow
def test_each_kind_of_case_is_answered_as_it_must_be() -> None:
    every = HEALTHY + SINGLES + PAIRS + ODD + LEFT_OUT
    rows = {row.case: row for row in run_cases(every, print)}
    for case in HEALTHY:
        assert (rows[case].found.verdict, rows[case].named) == ("no_gap", {})
    for case in SINGLES:
        assert next(iter(rows[case].named)) in case.causes
    assert all(case.names <= rows[case].likely for case in PAIRS)
    assert not any(p > SURE for case in ODD + LEFT_OUT for p in rows[case].named.values())


def test_without_recordings_of_real_machines_there_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(real_machines, "DATA", tmp_path)
    assert main(["bench", "diagnose", "--only", "real-machines"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith(f"no recording of emps or cranfield in {tmp_path}")


@pytest.mark.slow
@pytest.mark.parametrize("error", ["", "drag_error", "load_offset", "hum"])
def test_a_real_axis_with_an_error_is_named_rightly(error: str) -> None:
    if not (DATA / "emps").is_dir():
        pytest.skip("the recordings of emps are not here")
    first = recordings(DATA)[0]
    found = run_case(first, SeededCase(first.name, error, "large" if error else ""), seed=9)
    if error in OPEN:
        assert found.verdict == "unknown" or found.effects[0][1] <= 0.5
    else:
        assert found.right, found.effects


@pytest.mark.slow
@pytest.mark.skipif(not (BESIDE / MAKE).is_file(), reason=f"no second plant in {BESIDE}")
def test_the_installed_command_is_scored_on_the_second_plant() -> None:
    line = ["diagnose", "--only", "second-plant", "--quick", "--seed", "11"]
    table = CliRunner().invoke(bench, line, catch_exceptions=False).stdout
    assert "singles, all strengths: named first" in table
    assert "50 Hz: healthy no_gap" in table
