"""A plant of many machines: who reads which part, what is shown, and what is said to be missing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edge_service.health.fleet.machines import FleetMachines
from edge_service.health.fleet.ownership import owned_by, owner_of
from edge_service.health.fleet.plant_rows import plant_table
from edge_service.messages.estimate import EstimateStatus, Interval
from edge_service.messages.fleet import Cursor, RowsAnswer
from edge_service.messages.health import AxisCondition
from edge_service.messages.plant import BUCKETS, AxisReport, MachineReport, PlantKeys

S = 1_000_000_000
NAMES = st.sets(st.text("abcdefgh-0123456789", min_size=1, max_size=12), min_size=1, max_size=8)


def report(machine: str, *conditions: AxisCondition, loss: float = 10.0) -> MachineReport:
    """A report of axes X0, X1, ... in these conditions."""
    axes = tuple(
        AxisReport(
            axis=f"X{k}",
            condition=condition,
            status=EstimateStatus.ESTIMATED,
            preload_percent=8.0,
            low=7.5,
            high=8.5,
            fresh_percent=10.0,
            loss_per_1000_h=Interval(value=loss + 0.1 * k, low=loss - 1.0, high=loss + 1.0),
        )
        for k, condition in enumerate(conditions)
    )
    return MachineReport(site="hall", machine=machine, time_ns=0, version="1", axes=axes)


def answer(node: str, machines: FleetMachines, now_ns: int, buckets: set[int]) -> RowsAnswer:
    return RowsAnswer(
        node=node,
        instance=node,
        time_ns=now_ns,
        buckets=tuple(buckets),
        machines=machines.told(now_ns),
    )


ALL = set(range(BUCKETS))


@given(NAMES)
def test_each_part_of_the_plant_has_one_owner(nodes: set[str]) -> None:
    shares = [owned_by(node, nodes) for node in nodes]
    assert sum(map(len, shares)) == BUCKETS
    assert frozenset().union(*shares) == ALL


@given(NAMES, st.randoms(use_true_random=False))
def test_a_node_that_goes_or_comes_moves_its_own_parts_alone(nodes: set[str], random) -> None:
    gone = random.choice(sorted(nodes))
    left = nodes - {gone}
    for bucket in range(BUCKETS):
        before = owner_of(bucket, nodes)
        assert owner_of(bucket, left) == before or before == gone


def test_parts_spread_evenly_over_nodes_as_they_are_named() -> None:
    for count in (2, 3, 4, 8):
        nodes = [f"fleet-{k}" for k in range(count)]
        shares = [len(owned_by(node, nodes)) for node in nodes]
        assert max(shares) <= 2.0 * BUCKETS / count


def test_without_nodes_nobody_reads() -> None:
    assert owner_of(0, ()) is None


def test_a_silent_machine_shows_no_number_and_stays_in_the_list() -> None:
    machines = FleetMachines()
    machines.on_report(report("m1", AxisCondition.FAULT), S, 0, 0)
    (row,) = plant_table([answer("a", machines, 2 * S, ALL)], {"a"}).rows
    assert row.condition is AxisCondition.FAULT
    assert row.share_percent == pytest.approx(80.0)
    (row,) = plant_table([answer("a", machines, 7 * S, ALL)], {"a"}).rows
    assert row.condition is AxisCondition.UNAVAILABLE
    assert row.reason == "not heard since 1970-01-01T00:00:01.000Z; it was FAULT then"
    assert row.preload_percent is row.share_percent is row.age_s is row.limit is None
    assert row.loss_percent_per_1000_h is row.peers is None


def test_a_machine_whose_publisher_is_gone_is_silent_at_once() -> None:
    machines = FleetMachines()
    machines.on_report(report("m1", AxisCondition.NORMAL), S, 0, 0)
    machines.on_presence(("hall", "m1"), False)
    assert not machines.told(S)[0].current
    machines.on_presence(("hall", "m1"), True)
    assert machines.told(S)[0].current


def test_the_owners_word_counts_whatever_the_clocks_of_others_say() -> None:
    """The old owner's clock is an hour ahead."""
    old, new = FleetMachines(), FleetMachines()
    old.on_report(report("m1", AxisCondition.NORMAL), 3600 * S, 0, 0)
    new.on_report(report("m1", AxisCondition.FAULT), S, 0, 0)
    answers = [answer("old", old, 3600 * S, set()), answer("new", new, S, ALL)]
    for order in (answers, answers[::-1]):
        (row,) = plant_table(order, {"old", "new"}).rows
        assert row.condition is AxisCondition.FAULT


def test_until_the_new_owner_has_heard_a_machine_the_old_ones_word_stands() -> None:
    old, new = FleetMachines(), FleetMachines()
    old.on_report(report("m1", AxisCondition.NORMAL), S, 0, 0)
    new.learn(old.told(S))
    answers = [answer("new", new, S, ALL), answer("old", old, S, set())]
    (row,) = plant_table(answers, {"old", "new"}).rows
    assert row.condition is AxisCondition.NORMAL
    old.keep(set(), 10 * S)
    (row,) = plant_table([answer("old", old, 10 * S, set())], {"old"}).rows
    assert row.condition is AxisCondition.UNAVAILABLE


def test_what_is_missing_is_named() -> None:
    machines = FleetMachines()
    half = {each for each in ALL if each % 2}
    assert plant_table([answer("a", machines, 0, ALL)], {"a"}).missing == ()
    silent, part = plant_table([answer("a", machines, 0, half)], {"a", "b"}).missing
    assert silent == "the fleet node b does not answer"
    assert part.startswith("part of the plant is not shown: 32 of its 64 parts")
    table = plant_table([], {"a"})
    assert [state.answered for state in table.nodes] == [False]
    assert len(table.missing) == 2


def test_two_nodes_of_one_name_are_seen() -> None:
    machines = FleetMachines()
    first = answer("a", machines, 0, ALL)
    second = first.model_copy(update={"instance": "other"})
    (state,) = plant_table([first, second], {"a"}).nodes
    assert state.problems == ("another fleet node has the same name",)


def test_a_machine_that_was_removed_comes_back_when_it_is_heard() -> None:
    machines, other = FleetMachines(), FleetMachines()
    machines.on_report(report("m1", AxisCondition.NORMAL), S, 0, 0)
    other.learn(machines.told(S))
    assert machines.remove(("hall", "m1"), 2 * S)
    assert not machines.remove(("hall", "m2"), 2 * S)
    answers = [answer("a", machines, 3 * S, ALL), answer("b", other, 3 * S, set())]
    assert plant_table(answers, {"a", "b"}).rows == ()
    machines.on_report(report("m1", AxisCondition.NORMAL), 4 * S, 0, 0)
    assert len(plant_table([answer("a", machines, 4 * S, ALL)], {"a"}).rows) == 1


def test_cursors_go_along_and_never_back() -> None:
    machines, other = FleetMachines(), FleetMachines()
    machines.on_report(report("m1", AxisCondition.NORMAL), S, 0, 0)
    machines.advance(("hall", "m1"), Cursor(log="l", number=7))
    other.learn(machines.told(S))
    machines.advance(("hall", "m1"), Cursor(log="l", number=9))
    machines.learn(other.told(S))
    known = machines.get(("hall", "m1"))
    assert known is not None
    assert known.cursor == Cursor(log="l", number=9)


def test_a_flood_of_machines_is_bounded() -> None:
    machines = FleetMachines(most=2)
    for name in ("m1", "m2", "m3"):
        machines.on_report(report(name, AxisCondition.NORMAL), S, 0, 0)
    assert len(machines) == 2
    assert machines.refused == 1


def test_peers_are_compared_over_the_whole_plant() -> None:
    machines = FleetMachines()
    for k in range(20):
        loss = 80.0 if k == 7 else 10.0 + 0.1 * k
        machines.on_report(report(f"m{k}", AxisCondition.NORMAL, loss=loss), S, 0, 0)
    first, *others = plant_table([answer("a", machines, S, ALL)], {"a"}).rows
    assert first.machine == "m7"
    assert first.peers is not None
    assert first.peers.faster
    assert not any(row.peers is not None and row.peers.faster for row in others)


def test_a_machine_falls_into_a_part_by_its_name_alone() -> None:
    assert PlantKeys("hall", "m1").bucket == PlantKeys("hall", "m1").bucket < BUCKETS


def test_a_number_grows_older_until_the_next_report() -> None:
    """Machines may report once an hour, and their clocks need not be ours."""
    axis = report("m1", AxisCondition.NORMAL).axes[0].model_copy(update={"time_ns": 90 * S})
    told = report("m1").model_copy(update={"time_ns": 92 * S, "period_s": 3600.0, "axes": (axis,)})
    machines = FleetMachines()
    machines.on_report(told, 5000 * S, 0, 0)
    for passed_s in (0, 7, 3000):
        said = answer("one", machines, (5000 + passed_s) * S, ALL)
        (row,) = plant_table([said], ["one"]).rows
        assert row.age_s == 2.0 + passed_s
