"""Why an effect is not judged: a channel is blamed only if it would have shown the effect."""

import pytest

from edge_service.diagnose.candidates import regressors
from edge_service.diagnose.candidates.regressors import unobservable
from edge_service.diagnose.session.session import Session
from edge_service.messages.samples import TABLE_POSITION, TORQUE
from edge_service.models.machine import Machine

from ..conftest import frame_of, recorded, session_of

BLAMED = {TABLE_POSITION: "one encoder only", TORQUE: "no torque recorded"}


@pytest.fixture(scope="module")
def lacking(machine: Machine) -> dict[str, Session]:
    """A session without each of the channels."""
    recording = recorded((), seed=3)
    return {name: session_of(machine, frame_of(recording, **{name: None})) for name in BLAMED}


@pytest.mark.parametrize("missing", BLAMED)
def test_a_motion_that_shows_nothing_is_not_the_fault_of_a_channel(
    missing: str, lacking: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Effects that only the other channel shows are not seen for another reason."""
    shown_by = {name: set(unobservable(session)) for name, session in lacking.items()}
    monkeypatch.setattr(regressors, "_shows", lambda _effect, _session, _ranges: False)
    reasons = unobservable(lacking[missing])
    for channel, names in shown_by.items():
        assert names & reasons.keys()
        for name in names & reasons.keys():
            assert reasons[name].startswith(BLAMED[missing]) == (channel == missing), name
