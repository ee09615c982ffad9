"""Messages wait on disk: in order, across restarts, up to a bound."""

import asyncio
from pathlib import Path

import pytest

from edge_service.bus.mqtt.spool import Spool, SpoolError


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "spool.sqlite"


def payloads(spool: Spool, count: int = 1000) -> list[bytes]:
    return [message.payload for message in spool.oldest(count)]


async def test_messages_leave_in_the_order_in_which_they_came(path: Path) -> None:
    spool = Spool(path, 100)
    for number in range(10):
        spool.put("a/b", b"%d" % number)
    assert len(spool) == 10
    first = spool.oldest(3)
    assert [(each.topic, each.payload) for each in first] == [
        ("a/b", b"0"),
        ("a/b", b"1"),
        ("a/b", b"2"),
    ]
    spool.remove(first)
    spool.remove(first)
    assert len(spool) == 7
    assert payloads(spool)[0] == b"3"
    spool.close()
    spool.close()


async def test_what_was_not_taken_survives_the_process(path: Path) -> None:
    spool = Spool(path, 100)
    for number in range(5):
        spool.put("t", b"%d" % number)
    spool.remove(spool.oldest(2))
    spool.close()
    again = Spool(path, 100)
    assert payloads(again) == [b"2", b"3", b"4"]
    again.put("t", b"5")
    assert payloads(again) == [b"2", b"3", b"4", b"5"]
    again.close()


async def test_connections_are_counted_across_restarts(path: Path) -> None:
    for number in range(3):
        spool = Spool(path, 5)
        assert spool.sessions == number
        spool.count_session()
        spool.close()


async def test_the_newest_of_each_topic_is_known_again_after_a_restart(path: Path) -> None:
    spool = Spool(path, 100)
    for number in range(6):
        spool.put(f"X/{number % 2}", b"%d" % number)
    newest = dict(spool.newest)
    assert {topic: each.payload for topic, each in newest.items()} == {"X/0": b"4", "X/1": b"5"}
    spool.remove(spool.oldest(2))
    assert spool.newest == newest
    spool.close()
    again = Spool(path, 100)
    assert again.newest == newest
    again.close()


async def test_a_disk_that_is_full_costs_messages_and_nothing_else(path: Path) -> None:
    spool = Spool(path, 100)
    spool.put("t", b"0")
    spool._file.execute("PRAGMA max_page_count = 1")  # SQLite then says that the disk is full
    for _ in range(5):
        spool.put("t", bytes(100_000))
    assert spool.dropped == 5
    assert payloads(spool) == [b"0"]
    spool.close()


async def test_a_full_spool_drops_the_oldest_and_counts(path: Path) -> None:
    spool = Spool(path, 5)
    for number in range(12):
        spool.put("t", b"%d" % number)
    assert payloads(spool) == [b"7", b"8", b"9", b"10", b"11"]
    assert spool.dropped == 7
    assert len(spool) == 5
    spool.close()


async def test_a_reader_sleeps_until_there_is_something(path: Path) -> None:
    spool = Spool(path, 5)
    waiting = asyncio.create_task(spool.wait())
    for _ in range(3):
        await asyncio.sleep(0)
    assert not waiting.done()
    spool.put("t", b"x")
    async with asyncio.timeout(5.0):
        await waiting
        await spool.wait()
    spool.close()


async def test_a_file_that_is_something_else_is_refused_and_left_alone(tmp_path: Path) -> None:
    other = tmp_path / "notes.txt"
    other.write_text("these are notes, and no database at all\n" * 50)
    with pytest.raises(SpoolError, match=r"notes\.txt: cannot hold messages"):
        Spool(other, 5)
    assert other.read_text().startswith("these are notes")
    with pytest.raises(SpoolError, match="cannot hold messages"):
        Spool(Path("/proc/nosuch/spool"), 5)
