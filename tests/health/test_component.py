"""The component-status machine against its table of transitions, written out by hand."""

from itertools import pairwise, product

import pytest

from edge_service.health.components import ComponentStatusMachine, IllegalTransitionError
from edge_service.messages.health import ComponentStatus

STARTING, OK = ComponentStatus.STARTING, ComponentStatus.OK
RECOVERABLE, PERMANENT = ComponentStatus.RECOVERABLE_ERROR, ComponentStatus.PERMANENT_ERROR
STOPPING, STOPPED = ComponentStatus.STOPPING, ComponentStatus.STOPPED

PATHS = {
    STARTING: (),
    OK: (OK,),
    RECOVERABLE: (RECOVERABLE,),
    PERMANENT: (PERMANENT,),
    STOPPING: (STOPPING,),
    STOPPED: (STOPPING, STOPPED),
}
LEGAL = {
    (STARTING, OK), (STARTING, RECOVERABLE), (STARTING, PERMANENT), (STARTING, STOPPING),
    (OK, RECOVERABLE), (OK, PERMANENT), (OK, STOPPING),
    (RECOVERABLE, OK), (RECOVERABLE, PERMANENT), (RECOVERABLE, STOPPING),
    (PERMANENT, STOPPING), (STOPPING, STOPPED),
}  # fmt: skip


def _machine_in(status: ComponentStatus) -> ComponentStatusMachine:
    machine = ComponentStatusMachine("acquire", "X")
    for each in PATHS[status]:
        machine.to(each)
    return machine


@pytest.mark.parametrize(("start", "end"), list(product(ComponentStatus, repeat=2)))
def test_every_transition_is_legal_or_raises(start, end):
    machine = _machine_in(start)
    if start is end:
        assert machine.to(end, "again") is False
        assert machine.reason == "again"
    elif (start, end) in LEGAL:
        assert machine.to(end, "why") is True
        assert machine.report().status is end
    else:
        with pytest.raises(IllegalTransitionError, match=f"from {start} to {end}"):
            machine.to(end)
        assert machine.status is start


def test_recovery_and_stop():
    machine = ComponentStatusMachine("estimate")
    for status in (OK, RECOVERABLE, OK, RECOVERABLE, STOPPING, STOPPED):
        machine.to(status, f"now {status}")
    report = machine.report({"blocks": 7})
    assert (report.component, report.axis, report.status) == ("estimate", None, STOPPED)
    assert report.reason == "now stopped"
    assert report.counters == {"blocks": 7}


def test_paths_of_this_test_are_legal():
    for path in PATHS.values():
        assert set(pairwise((STARTING, *path))) <= LEGAL
