"""Reports of a plant as they are read: no machine speaks for another, none drowns the others."""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable
from contextlib import aclosing

import pytest
import zenoh

from edge_service.bus.plant.fleet import FleetMembers, ask_rows, packed, present_nodes, unpacked
from edge_service.bus.plant.reporting import Reporting
from edge_service.bus.plant.reports import BURST, Heard, PlantReports, Seen
from edge_service.bus.plant.router import open_router
from edge_service.bus.plant.session import PlantSession, PlantSettings
from edge_service.messages.fleet import RowsAnswer
from edge_service.messages.header import Header
from edge_service.messages.plant import (
    BUCKETS,
    MOST_REPORT_BYTES,
    REPORT,
    MachineReport,
    PlantKeys,
    fleet_question,
)

from ..nodes.fleet.plants import free_port

S = 1_000_000_000


@pytest.fixture
def session() -> AsyncIterator[zenoh.Session]:
    """A router in this process: what is put here is heard here."""
    router = open_router([f"tcp/127.0.0.1:{free_port()}"])
    yield router
    router.close()


def report_of(machine: str) -> MachineReport:
    return MachineReport(site="s", machine=machine, time_ns=S, version="1", axes=())


def payload(machine: str, sequence: int, epoch: int = 1) -> bytes:
    header = Header(sequence, epoch, S, time.monotonic_ns())
    return REPORT.encode(None, header, report_of(machine))


async def heard(
    reports: PlantReports, put: Callable[[], None], last: tuple[str, int]
) -> list[tuple[str, int]]:
    """Machine and sequence of all that passes, up to a certain report; keys are read in turn."""
    reports.aim(range(BUCKETS))
    reports.follow()
    put()
    found = []
    async with asyncio.timeout(20.0):
        async for each in reports:
            if isinstance(each, Seen):
                continue
            found.append((each.report.machine, each.header.sequence))
            if found[-1] == last:
                return found
    raise AssertionError("unreachable")


def key(machine: str) -> str:
    return PlantKeys("s", machine).report


async def test_what_cannot_be_believed_is_refused_and_counted(session: zenoh.Session) -> None:
    reports = PlantReports(session)
    wrong_bucket = key("m1").replace(f"/{PlantKeys('s', 'm1').bucket}/", "/63/", 1)
    assert wrong_bucket != key("m1")
    members = json.loads(payload("m1", 5))

    def put() -> None:
        session.put(key("m1"), payload("m1", 1))
        session.put(key("m1"), payload("m2", 2))  # speaks for another
        session.put(wrong_bucket, payload("m1", 3))
        session.put(key("m1"), b"garbage")
        session.put(key("m1"), json.dumps(members | {"sequence": -1}).encode())
        session.put(key("m1"), json.dumps(members | {"time_ns": 10**30}).encode())
        session.put(key("m1"), json.dumps(members | {"schema": "plant/9"}).encode())
        session.put(key("m1"), b" " * (MOST_REPORT_BYTES + 1))
        session.put(key("m1"), payload("m1", 4, epoch=2))  # a second publisher
        session.put(key("m1"), payload("m1", 1))
        session.put(key("m1"), payload("m1", 3))

    assert await heard(reports, put, ("m1", 3)) == [("m1", 1), ("m1", 3)]
    counts = reports.refusals.counts()
    of_m1 = {reason: count for (name, reason), count in counts.items() if name == key("m1")}
    assert of_m1 == {"misplaced": 1, "malformed": 4, "oversized": 1, "rival": 1, "late": 1}
    assert counts[wrong_bucket, "misplaced"] == 1
    reports.close()


async def test_a_flood_of_one_machine_leaves_the_others_alone(session: zenoh.Session) -> None:
    reports = PlantReports(session)
    flood = int(BURST) + 500

    def put() -> None:
        for sequence in range(flood):
            session.put(key("loud"), payload("loud", sequence))
        session.put(key("quiet"), payload("quiet", 0))

    assert len(await heard(reports, put, ("quiet", 0))) < BURST
    assert reports.refusals.counts()[key("loud"), "flooded"] > 0
    reports.close()


async def test_losses_are_counted_by_the_holes(session: zenoh.Session) -> None:
    reports = PlantReports(session)
    reports.aim(range(BUCKETS))
    reports.follow()
    for sequence in (3, 4, 9, 10):
        session.put(key("m1"), payload("m1", sequence))
    async with asyncio.timeout(20.0), aclosing(aiter(reports)) as passing:
        lost = [each.lost async for each in _four(passing)]
    assert lost == [0, 0, 4, 4]
    reports.close()


async def _four(passing: AsyncIterator[Heard | Seen]) -> AsyncIterator[Heard]:
    count = 0
    async for each in passing:
        if isinstance(each, Heard):
            yield each
            count += 1
        if count == 4:
            return


async def test_what_a_machine_said_before_it_fell_silent_is_heard_after_all() -> None:
    """It learns of what it has missed from a number that is told again and again, or never."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = open_router([endpoint])
    writer, reader = [await PlantSession.open(PlantSettings(endpoint)) for _ in range(2)]
    reports = PlantReports(reader.zenoh)
    reports.aim(range(BUCKETS))
    reports.follow()
    reporting = Reporting(
        writer, PlantKeys("s", "m1"), 0, 1.0, lambda _key, _question, _reply: None
    )
    last = -1

    def say(times: int) -> None:
        nonlocal last
        for _ in range(times):
            last = reporting.publish(report_of("m1")).sequence

    async with asyncio.timeout(60.0), aclosing(aiter(reports)) as passing:
        said = asyncio.create_task(_again_and_again(lambda: say(1)))
        first = await _report(passing)  # those before may have found no reader
        said.cancel()
        found = [first.header.sequence]
        router.close()
        while reader.is_connected or writer.is_connected:
            await asyncio.sleep(0.01)
        say(5)
        router = open_router([endpoint])
        while found[-1] != last:
            heard = await _report(passing)
            found.append(heard.header.sequence)
    assert found == list(range(found[0], last + 1))
    assert heard.lost == 0
    assert reports.counts()["missed"] == 0
    reporting.close()
    reports.close()
    for each in (writer, reader):
        await each.close()
    router.close()


async def test_a_reader_that_comes_later_begins_with_the_last_report() -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    router = open_router([endpoint])
    writer, reader = [await PlantSession.open(PlantSettings(endpoint)) for _ in range(2)]
    reporting = Reporting(
        writer, PlantKeys("s", "m1"), 0, 1.0, lambda _key, _question, _reply: None
    )
    for _ in range(4):
        reporting.publish(report_of("m1"))
    async with asyncio.timeout(20.0):  # until the router knows the machine
        while not list(reader.zenoh.liveliness().get(f"{key('m1')}/@adv/**", timeout=5.0)):
            await asyncio.sleep(0.01)
    reports = PlantReports(reader.zenoh)
    found = await heard(reports, lambda: None, ("m1", 3))
    assert found == [("m1", 3)]
    reporting.close()
    reports.close()
    for each in (writer, reader):
        await each.close()
    router.close()


async def _again_and_again(do: Callable[[], None]) -> None:
    while True:
        do()
        await asyncio.sleep(0.02)


async def _report(passing: AsyncIterator[Heard | Seen]) -> Heard:
    while True:
        each = await anext(passing)
        if isinstance(each, Heard):
            return each


async def test_a_part_that_others_read_is_not_heard(session: zenoh.Session) -> None:
    reports = PlantReports(session)
    reports.aim({PlantKeys("s", "m1").bucket})
    reports.follow()
    elsewhere = next(
        f"x{k}" for k in range(999) if PlantKeys("s", f"x{k}").bucket not in reports.buckets
    )
    session.put(key(elsewhere), payload(elsewhere, 0))
    session.put(key("m1"), payload("m1", 0))
    async with asyncio.timeout(20.0), aclosing(aiter(reports)) as passing:
        first = await anext(passing)
    assert isinstance(first, Heard)
    assert first.report.machine == "m1"
    reports.aim(())
    assert reports.buckets == frozenset()
    reports.close()
    reports.close()


async def test_fleet_nodes_see_each_other_come_and_go(session: zenoh.Session) -> None:
    changes: asyncio.Queue[frozenset[str]] = asyncio.Queue()
    one = FleetMembers(session, "one", changes.put_nowait)
    two = FleetMembers(session, "two", lambda _names: None)
    async with asyncio.timeout(20.0):
        assert await changes.get() == {"one", "two"}
        assert await present_nodes(session, 5.0) == {"one", "two"}
        two.close()
        assert await changes.get() == {"one"}
    one.close()
    one.close()


async def test_an_answer_that_is_none_is_not_there(session: zenoh.Session) -> None:
    answer = RowsAnswer(node="one", instance="i", time_ns=0)
    assert unpacked(RowsAnswer, packed(answer)) == answer
    assert unpacked(RowsAnswer, b"garbage") is None
    assert unpacked(RowsAnswer, packed(answer)[:-3]) is None
    said = {"one": packed(answer), "liar": packed(answer), "broken": b"garbage"}
    queryables = [
        session.declare_queryable(
            fleet_question(name, "rows"),
            lambda query, name=name: query.reply(fleet_question(name, "rows"), said[name]),
        )
        for name in said
    ]
    assert await ask_rows(session, 5.0) == [answer]  # nobody answers in the name of another
    for each in queryables:
        each.undeclare()
