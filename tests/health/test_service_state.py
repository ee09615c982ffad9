"""The service state: what may be shown, the event log, and readers that are too slow."""

import asyncio

from hypothesis import given, settings
from hypothesis import strategies as st

from edge_service.health.service_state import ServiceState
from edge_service.health.store.events import StoredEvent
from edge_service.health.store.readers import FanOut
from edge_service.messages.codec import Header
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.event import AxisCondition
from edge_service.messages.health import AxisHealth, ComponentHealth, ComponentStatus
from edge_service.messages.interval import Interval

from ..messages.examples import estimate_of, event_of

NS = 1_000_000_000
START_NS = 1_700_000_000 * NS
ESTIMATE = estimate_of(
    5.0,
    preload_n=372.5,
    drag_torque_nm=Interval(value=0.1, low=0.1, high=0.1),
    mode_probability={"5": 1.0},
    nis=1.0,
)
NUMBERS = ("preload_percent", "low", "high", "preload_n", "drag_torque_nm", "nis")


def _state() -> ServiceState:
    return ServiceState({"X": None, "Y": None}, START_NS)


def _header(sequence: int, time_ns: int, boot_epoch: int = START_NS) -> Header:
    return Header(sequence, boot_epoch, time_ns, time_ns)


def _normal(since_ns: int = START_NS, axis: str = "X") -> AxisHealth:
    return AxisHealth(axis=axis, condition=AxisCondition.NORMAL, since_time_ns=since_ns)


updates = st.lists(
    st.tuples(
        st.sampled_from(EstimateStatus),
        st.integers(0, 20),  # sequence
        st.integers(0, 2),  # boot
        st.integers(-5 * NS, 5 * NS),  # step of the clock
        st.integers(-5 * NS, 5 * NS),  # source time against the clock
    ),
    max_size=12,
)


@given(updates=updates, look=st.integers(-10 * NS, 10 * NS))
@settings(max_examples=150, deadline=None)
def test_numbers_only_ever_with_the_status_estimated_and_fresh_data(updates, look):
    state = _state()
    now_ns = START_NS
    for status, sequence, boot, step_ns, ahead_ns in updates:
        now_ns += step_ns
        header = Header(sequence, boot, now_ns + ahead_ns, 0)
        estimate = ESTIMATE.model_copy(update={"status": status})
        state.on_preload("X", header, estimate, now_ns)
    now_ns += look
    reading = state.preload("X", now_ns)
    numbers = [getattr(reading, name) for name in NUMBERS]
    if reading.status is EstimateStatus.ESTIMATED:
        assert None not in numbers
        assert reading.age_s <= 2.0
    else:
        assert numbers == [None] * len(NUMBERS)
        assert reading.mode_probability == {}


def test_condition_is_unavailable_as_soon_as_the_preload_is_stale():
    state = _state()
    state.on_preload("X", _header(0, START_NS), ESTIMATE, START_NS)
    for second in range(4):
        state.on_health(_header(second, START_NS + second * NS), _normal(), START_NS + second * NS)
    now_ns = START_NS + 3 * NS
    health = state.health("X", now_ns)
    assert health.condition is AxisCondition.UNAVAILABLE
    assert health.since_time_ns == START_NS + 2 * NS  # the topic's stale-after
    assert health.measured_time_ns == START_NS
    assert state.health("X", START_NS - 3600 * NS).measured_time_ns is None  # a clock set back


def test_condition_is_unavailable_when_it_is_not_renewed():
    state = _state()
    state.on_health(_header(0, START_NS), _normal(), START_NS)
    for second in range(8):
        now_ns = START_NS + second * NS
        state.on_preload("X", _header(second, now_ns), ESTIMATE, now_ns)
    assert state.preload("X", now_ns).status is EstimateStatus.ESTIMATED
    health = state.health("X", now_ns)
    assert health.condition is AxisCondition.UNAVAILABLE
    assert [reason.split(":")[0] for reason in health.reasons] == ["stale_health"]


def test_unready_names_every_axis_and_input():
    state = _state()
    state.on_preload("X", _header(0, START_NS), ESTIMATE, START_NS)
    state.on_health(_header(0, START_NS), _normal(), START_NS)
    codes = [tuple(reason.split(": ")[:2]) for reason in state.unready(START_NS)]
    assert codes == [("Y", "no_input"), ("Y", "no_health")]
    assert len(state.unready(START_NS + 60 * NS)) == 4
    assert ServiceState({}, START_NS).unready(START_NS) == ("no_axis: no axis is configured",)


def test_payloads_of_other_axes_are_ignored_and_counted():
    state = _state()
    state.on_preload("Q", _header(0, START_NS), ESTIMATE, START_NS)
    state.on_health(_header(0, START_NS), _normal(axis="Q"), START_NS)
    assert not state.concerns(event_of(axis="Q"))
    report = ComponentHealth(component="acquire", axis="Q", status=ComponentStatus.OK)
    state.on_component(report, START_NS)
    assert state.axes == ("X", "Y")
    assert state.ignored_payloads == 4


def test_components_are_the_monitor_s_with_the_newer_own_reports():
    state = _state()
    told = ComponentHealth(component="estimate", axis="X", status=ComponentStatus.STARTING)
    health = _normal().model_copy(update={"components": (told,)})
    state.on_health(_header(0, START_NS), health, START_NS)
    assert state.health("X", START_NS).components == (told,)
    own = ComponentHealth(component="estimate", axis="X", status=ComponentStatus.OK)
    shared = ComponentHealth(component="http", status=ComponentStatus.OK)
    state.on_component(own, START_NS)
    state.on_component(shared, START_NS)
    assert state.health("X", START_NS).components == (own,)
    assert state.components(START_NS, None) == (shared,)


async def test_slow_reader_loses_the_oldest_events_and_is_told():
    readers = FanOut(capacity=10)
    with readers.subscribe() as slow, readers.subscribe() as fast:
        received = []
        for number in range(1000):
            readers.put_event(StoredEvent(number, event_of()))
            readers.mark("preload", "X")
            received += [logged.id for logged in (await fast.next(1.0)).events]
            assert len(slow.events) + len(slow.changed) <= 11
        assert received == list(range(1000))
        batch = await slow.next(1.0)
    assert batch.lost == 990
    assert [logged.id for logged in batch.events] == list(range(990, 1000))
    assert batch.changed == (("preload", "X"),)


async def test_reader_of_one_axis_hears_it_and_the_service():
    readers = FanOut(capacity=10)
    with readers.subscribe("X") as reader:
        for number, axis in enumerate(["X", "Y", ""]):
            readers.put_event(StoredEvent(number, event_of(axis=axis)))
            readers.mark("health", axis)
        batch = await reader.next(1.0)
    assert [logged.event.axis for logged in batch.events] == ["X", ""]
    assert batch.changed == (("health", "X"),)
    assert len(readers) == 0


async def test_close_wakes_waiting_and_future_readers():
    state = _state()
    with state.readers.subscribe() as reader:
        waiting = asyncio.create_task(reader.next(60.0))
        await asyncio.sleep(0)
        state.readers.close()
        assert (await waiting).events == ()
        assert reader.closed
    with state.readers.subscribe() as late:
        assert late.closed
