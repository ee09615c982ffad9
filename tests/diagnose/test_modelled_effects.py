"""An effect that the machine file has is not named again."""

import pytest

from edge_service.diagnose.experiment import healthy_session
from edge_service.diagnose.pipeline import diagnose_session
from edge_service.diagnose.result import Verdict
from edge_service.models.machine import EffectConfig, Machine

from .conftest import frame_of, recorded, runs

MODELLED = (
    *("backlash", "compliance", "drag_error", "encoder_eccentricity", "inertia_error"),
    *("lead_error", "stribeck", "timestamp_skew", "torque_ripple", "viscous_error"),
)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELLED)
def test_what_the_machine_file_has_is_not_named_again(machine: Machine, name: str) -> None:
    knowing = machine.model_copy(update={"effects": (EffectConfig(name=name),)})
    motion = runs(machine, frame_of(recorded((), 3)))
    session = healthy_session(knowing, motion)
    found = diagnose_session(session, knowing)
    assert name not in {each.name for each in found.effects if each.probability > 0.5}
    assert found.verdict in (Verdict.NO_GAP, Verdict.UNKNOWN)
