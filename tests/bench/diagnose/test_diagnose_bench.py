"""Small cases of the benches of the diagnosis: what must hold whatever their numbers."""

from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.diagnose.result import SURE

from ...hidden_effects.cases import HiddenCase
from .. import real_machines
from ..real_machines import DATA
from .bench import run_cases
from .seeded_errors import OPEN, SeededCase, recordings, run_case


def hidden(seed: int, motion: str, *causes: str, without: tuple[str, ...] = ()) -> HiddenCase:
    return HiddenCase(causes, 1.0, motion, seed, without)


QUIET = [hidden(70, "full"), hidden(71, "staircase")]
NAMED = [
    hidden(80, "staircase", "position_friction"),
    hidden(81, "production", "backlash"),
    hidden(90, "production", "load_offset", "encoder_eccentricity"),
    hidden(91, "staircase", "drag_error", "timestamp_skew"),
]
UNSURE = [
    hidden(100, "production", "stuck_seal"),
    hidden(101, "production", "loose_fixture"),
    hidden(102, "production", "crosstalk"),
    hidden(110, "staircase", "torque_ripple", without=("torque_ripple",)),
    hidden(111, "staircase", "position_friction", without=("position_friction",)),
]


@pytest.mark.slow
@pytest.mark.smoke
def test_a_healthy_axis_is_quiet_and_a_single_cause_leads() -> None:
    answers = run_cases([QUIET[1], NAMED[0]], print)
    assert {row.case: row.outcome for row in answers} == {QUIET[1]: "quiet", NAMED[0]: "named"}


@pytest.mark.slow
def test_each_kind_of_case_is_answered_as_it_must_be() -> None:
    rows = {row.case: row for row in run_cases(QUIET + NAMED + UNSURE, print)}
    assert {rows[case].outcome for case in QUIET} == {"quiet"}
    for case in NAMED:
        assert case.names <= rows[case].likely
        assert next(iter(rows[case].named)) in case.names
    assert not any(p > SURE for case in UNSURE for p in rows[case].named.values())


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
