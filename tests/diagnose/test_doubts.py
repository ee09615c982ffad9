"""Findings of `doctor` are known to the diagnosis: a lag that it misses makes its causes unsure."""

import pytest

from edge_service.checks.finding import Finding
from edge_service.checks.finding import Verdict as Check
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Verdict
from edge_service.models.machine import Machine
from edge_service.offline.diagnosis.witnesses import beside_doubts, doubts

from .conftest import frame_of, recorded, runs, session_of

LAG = Finding("encoder_lag", Check.DOUBTFUL, "linear encoder lags rotary by 0.45 ms")


@pytest.mark.slow
def test_an_encoder_that_lags_is_found_by_both(machine: Machine) -> None:
    frame = frame_of(recorded(("timestamp_skew",), 3, 8.0))
    (doubted,) = doubts(machine, runs(machine, frame))
    assert doubted.name == "encoder_lag"
    found = diagnose_session(session_of(machine, frame), machine)
    assert [each.name for each in found.effects] == ["timestamp_skew"]
    assert beside_doubts(found, [doubted]) is found


@pytest.mark.parametrize("causes", [(), ("drag_error",), ("compliance",)])
def test_encoders_in_step_are_not_doubted(machine: Machine, causes: tuple[str, ...]) -> None:
    assert doubts(machine, runs(machine, frame_of(recorded(causes, 3)))) == []


@pytest.mark.slow
def test_a_lag_that_the_causes_lack_is_tied_with_what_it_passes_for(machine: Machine) -> None:
    found = diagnose_session(session_of(machine, frame_of(recorded(("compliance",), 3))), machine)
    assert found.verdict is Verdict.EXPLAINED
    unsure = beside_doubts(found, [LAG])
    assert unsure.verdict is Verdict.AMBIGUOUS
    (compliance,) = unsure.effects
    assert compliance.tied == ("compliance", "timestamp_skew")
    assert compliance.probability <= 0.5
    assert beside_doubts(found, []) is found
