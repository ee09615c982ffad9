"""Messages wait on disk: in order, across restarts, up to a bound."""

import asyncio
import random
import resource
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from edge_service.bus.spool import ledger as ledger_module
from edge_service.bus.spool import spool as spool_module
from edge_service.bus.spool.message import DeadLetter
from edge_service.bus.spool.spool import Spool


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "deep" / "spool.sqlite"


async def payloads(spool: Spool, count: int = 1000) -> list[bytes]:
    return [message.payload for message in await spool.oldest(count)]


async def test_messages_leave_in_the_order_in_which_they_came(path: Path) -> None:
    spool = await Spool.open(path, 100)
    for number in range(10):
        await spool.put("a/b", b"%d" % number)
    assert len(spool) == 10
    first = await spool.oldest(3)
    assert [(each.topic, each.payload) for each in first] == [
        ("a/b", b"0"),
        ("a/b", b"1"),
        ("a/b", b"2"),
    ]
    await spool.remove(first)
    await spool.remove(first)
    assert len(spool) == 7
    assert (await payloads(spool))[0] == b"3"
    spool.close()
    spool.close()


async def test_what_was_not_taken_survives_the_process(path: Path) -> None:
    spool = await Spool.open(path, 100)
    for number in range(5):
        await spool.put("t", b"%d" % number)
    await spool.remove(await spool.oldest(2))
    spool.close()
    again = await Spool.open(path, 100)
    assert (await payloads(again)) == [b"2", b"3", b"4"]
    await again.put("t", b"5")
    assert (await payloads(again)) == [b"2", b"3", b"4", b"5"]
    again.close()


async def test_connections_are_counted_across_restarts(path: Path) -> None:
    for number in range(3):
        spool = await Spool.open(path, 5)
        assert spool.sessions == number
        await spool.count_session()
        spool.close()


async def test_the_newest_of_each_topic_is_known_again_after_a_restart(path: Path) -> None:
    spool = await Spool.open(path, 100)
    for number in range(6):
        await spool.put(f"X/{number % 2}", b"%d" % number)
    newest = dict(spool.newest)
    assert {topic: each.payload for topic, each in newest.items()} == {"X/0": b"4", "X/1": b"5"}
    await spool.remove(await spool.oldest(2))
    assert spool.newest == newest
    spool.close()
    again = await Spool.open(path, 100)
    assert again.newest == newest
    again.close()


async def test_a_full_spool_drops_the_oldest_and_counts(path: Path) -> None:
    spool = await Spool.open(path, 5)
    for number in range(12):
        await spool.put("t", b"%d" % number)
    assert (await payloads(spool)) == [b"7", b"8", b"9", b"10", b"11"]
    assert spool.dropped == 7
    assert len(spool) == 5
    spool.close()


async def test_a_reader_sleeps_until_there_is_something(path: Path) -> None:
    spool = await Spool.open(path, 5)
    waiting = asyncio.create_task(spool.wait())
    for _ in range(3):
        await asyncio.sleep(0)
    assert not waiting.done()
    await spool.put("t", b"x")
    async with asyncio.timeout(5.0):
        await waiting
        await spool.wait()
    spool.close()


@contextmanager
def full_disk() -> Iterator[None]:
    """No file of this process takes a byte; the system says so at each write."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


async def test_a_failing_disk_costs_nothing_and_what_it_did_not_take_is_written_later(
    path: Path,
) -> None:
    spool = await Spool.open(path, 100)
    await spool.put("t", b"0")
    with full_disk():
        for number in range(1, 4):
            await spool.put("t", b"%d" % number)
        assert spool.problem
        assert (await payloads(spool))[-3:] == [b"1", b"2", b"3"]
        taken = await spool.oldest(2)
        await spool.remove(taken)
        assert (await payloads(spool))[-1] == b"3"
    await spool.put("t", b"4")
    assert (spool.problem, spool.dropped) == ("", 0)
    left = [b"%d" % number for number in range(5)]
    for message in taken:
        left.remove(message.payload)
    assert await payloads(spool) == left
    assert len(spool) == 3
    spool.close()
    again = await Spool.open(path, 100)
    assert await payloads(again) == left
    again.close()


async def test_a_disk_that_is_full_at_the_start_blocks_nothing(path: Path) -> None:
    spool = await Spool.open(path, 100)
    await spool.put("t", b"kept")
    spool.close()
    with full_disk():
        spool = await Spool.open(path, 100)
        await spool.put("t", b"new")
        assert spool.problem
        assert (await payloads(spool))[-1] == b"new"
    await spool.put("t", b"newer")
    assert await payloads(spool) == [b"kept", b"new", b"newer"]
    spool.close()


async def test_what_neither_disk_nor_memory_holds_is_dropped_and_counted(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ledger_module, "MOST_UNWRITTEN", 6)
    spool = await Spool.open(path, 100)
    with full_disk():
        for _ in range(5):
            await spool.put("t", b"x")
    assert (len(spool), spool.dropped) == (3, 2)
    spool.close()


async def test_a_reader_writes_what_waits_as_soon_as_the_disk_takes_it(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spool_module, "_AGAIN_S", 0.0)
    spool = await Spool.open(path, 100)
    with full_disk():
        await spool.put("t", b"x")
        await spool.remove(await spool.oldest(1))
        waiting = asyncio.create_task(spool.wait())
        await asyncio.sleep(0)
        assert spool.problem
    async with asyncio.timeout(5.0):
        while spool.problem:
            await asyncio.sleep(0)
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
    spool.close()


@pytest.mark.parametrize("place", ["/proc/nosuch/spool", "/dev/null/spool"])
async def test_a_place_where_nothing_can_be_kept_blocks_nothing(place: str) -> None:
    spool = await Spool.open(Path(place), 5)
    await spool.put("t", b"x")
    assert spool.problem
    assert await payloads(spool) == [b"x"]
    await spool.remove(await spool.oldest(1))
    assert len(spool) == 0
    spool.close()


async def test_a_file_that_is_something_else_is_set_aside_and_named(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    other = tmp_path / "notes.txt"
    other.write_text("these are notes, and no database at all\n" * 50)
    spool = await Spool.open(other, 5)
    await spool.put("t", b"x")
    assert await payloads(spool) == [b"x"]
    assert (tmp_path / "notes.txt.damaged").read_text().startswith("these are notes")
    assert "notes.txt: file is not a database, kept as notes.txt.damaged" in caplog.text
    spool.close()


def _torn(content: bytearray, _random: random.Random) -> None:
    del content[len(content) // 2 :]


def _emptied(content: bytearray, _random: random.Random) -> None:
    content.clear()


def _flipped(content: bytearray, chance: random.Random) -> None:
    content[chance.randrange(len(content))] ^= 1 << chance.randrange(8)


def _overwritten(content: bytearray, chance: random.Random) -> None:
    start = chance.randrange(len(content))
    content[start : start + 600] = chance.randbytes(len(content[start : start + 600]))


@pytest.mark.parametrize("damage", [_torn, _emptied, _flipped, _overwritten])
@pytest.mark.parametrize("seed", range(6))
async def test_no_damage_blocks_a_start_or_is_handed_out(
    damage: Callable[[bytearray, random.Random], None], seed: int, path: Path
) -> None:
    """Whatever byte is wrong: what comes out was put in, in its order, and the spool goes on."""
    spool = await Spool.open(path, 1000)
    put_in = [b"%d " % number + bytes(300) for number in range(60)]
    for each in put_in:
        await spool.put("t", each)
    spool.close()
    content = bytearray(path.read_bytes())
    damage(content, random.Random(seed))
    path.write_bytes(content)
    again = await Spool.open(path, 1000)
    left = await payloads(again)
    assert left == [each for each in put_in if each in left]
    await again.put("t", b"new")
    assert (await payloads(again))[-1] == b"new"
    await again.remove(await again.oldest(1000))
    assert len(again) == 0
    again.close()


async def test_a_dead_letter_survives_and_may_be_tried_again_or_dropped(path: Path) -> None:
    spool = await Spool.open(path, 100)
    for number in range(3):
        await spool.put("t", b"%d" % number)
    for message in await spool.oldest(2):
        await spool.count(message, refused=True)
        await spool.bury(
            DeadLetter(message.key, message.topic, message.payload, 1, "answered 500", 7)
        )
    spool.close()
    again = await Spool.open(path, 100)
    first, second = await again.letters()
    assert (again.dead, len(again)) == (2, 1)
    assert (first.payload, first.reason, first.time_ns) == (b"0", "answered 500", 7)
    assert await again.revive(first.key)
    assert not await again.revive(first.key)
    assert await again.forget(second.key)
    assert not await again.forget(second.key)
    assert await payloads(again) == [b"2", b"0"]
    assert [each.refusals for each in await again.oldest(9)] == [0, 0]
    again.close()


async def test_tries_are_counted_across_restarts(path: Path) -> None:
    for number in range(3):
        spool = await Spool.open(path, 5)
        if number == 0:
            await spool.put("t", b"x")
        (message,) = await spool.oldest(1)
        assert (message.refusals, message.delays) == (number, number)
        await spool.count(message, refused=True)
        await spool.count(message, refused=False)
        spool.close()


async def test_bytes_are_bounded_too(path: Path) -> None:
    spool = await Spool.open(path, 100, most_bytes=1000)
    for number in range(10):
        await spool.put("t", b"%d" % number + bytes(299))
    assert [payload[:1] for payload in await payloads(spool)] == [b"7", b"8", b"9"]
    assert spool.dropped == 7
    spool.close()


async def test_the_file_of_an_older_version_is_read(path: Path) -> None:
    path.parent.mkdir(parents=True)
    with closing(sqlite3.connect(path)) as file:
        file.execute(
            "CREATE TABLE messages (number INTEGER PRIMARY KEY AUTOINCREMENT, "
            "topic TEXT NOT NULL, payload BLOB NOT NULL)"
        )
        for number in range(3):
            file.execute("INSERT INTO messages (topic, payload) VALUES ('t', ?)", (b"%d" % number,))
        file.execute("PRAGMA user_version = 7")
        file.commit()
    spool = await Spool.open(path, 100)
    assert await payloads(spool) == [b"0", b"1", b"2"]
    assert spool.sessions == 7
    spool.close()


async def test_what_was_put_durably_survives_a_kill(path: Path) -> None:
    program = (
        "import asyncio, os, sys\nfrom pathlib import Path\n"
        "from edge_service.bus.spool.spool import Spool\n"
        "async def main():\n"
        "    spool = await Spool.open(Path(sys.argv[1]), 100)\n"
        "    for number in range(20):\n"
        "        await spool.put('t', b'%d' % number)\n"
        "    os.kill(os.getpid(), 9)\n"
        "asyncio.run(main())\n"
    )
    done = await asyncio.to_thread(subprocess.run, [sys.executable, "-c", program, str(path)])
    assert done.returncode == -9
    spool = await Spool.open(path, 100)
    assert await payloads(spool) == [b"%d" % number for number in range(20)]
    spool.close()
