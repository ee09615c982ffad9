"""The file outlives what happens to it: errors, damage, other users; tokens changed by many."""

import sqlite3
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from edge_service.health.store.events import EventLog
from edge_service.health.store.store import Store, StoreFailedError
from edge_service.health.store.tokens import TokenError, Tokens, token_of
from tests.messages.examples import event_of

SCHEMA = "CREATE TABLE IF NOT EXISTS words (id INTEGER PRIMARY KEY, word TEXT NOT NULL);"


def opened(path: Path | None) -> Store:
    store = Store(path)
    store.define(SCHEMA)
    return store


@pytest.fixture(params=[True, False], ids=["file", "memory"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Store]:
    with closing(opened(tmp_path / "state" / "a.sqlite" if request.param else None)) as made:
        yield made


def put(store: Store, *words: str) -> None:
    def work(file: sqlite3.Connection) -> None:
        file.executemany("INSERT INTO words (word) VALUES (?)", [(word,) for word in words])

    store.write(work)


def words(store: Store) -> list[str]:
    found: list[tuple[str]] = store.read(
        lambda file: file.execute("SELECT word FROM words ORDER BY id").fetchall()
    )
    return [word for (word,) in found]


def test_an_error_of_the_work_undoes_it_and_is_raised_as_it_is(store: Store) -> None:
    def work(file: sqlite3.Connection) -> None:
        file.execute("INSERT INTO words (word) VALUES ('half')")
        raise KeyError("mine")

    with pytest.raises(KeyError):
        store.write(work)
    with pytest.raises(OverflowError):
        store.write(lambda file: file.execute("INSERT INTO words VALUES (?, 'x')", (2**70,)))
    assert words(store) == []
    assert not store.problem


def test_a_table_that_is_defined_later_is_there(store: Store) -> None:
    put(store, "one")
    store.define("CREATE TABLE IF NOT EXISTS more (id INTEGER)")
    store.write(lambda file: file.execute("INSERT INTO more VALUES (1)"))
    assert store.read(lambda file: file.execute("SELECT * FROM more").fetchall()) == [(1,)]
    assert words(store) == ["one"]


async def test_work_is_done_in_another_thread(store: Store) -> None:
    await store.run(put, store, "one")
    assert await store.run(words, store) == ["one"]


def test_it_outlives_its_process_and_only_its_group_may_read_it(tmp_path: Path) -> None:
    path = tmp_path / "state" / "a.sqlite"
    store = opened(path)
    put(store, "one")
    modes = {each.name: each.stat().st_mode & 0o777 for each in path.parent.iterdir()}
    assert modes == dict.fromkeys(("a.sqlite", "a.sqlite-wal", "a.sqlite-shm"), 0o640)
    assert path.parent.stat().st_mode & 0o777 == 0o750
    store.close()
    with closing(opened(path)) as again:
        assert words(again) == ["one"]


def damaged(path: Path, at: int = 0, content: bytes = b"\xff" * 4096) -> None:
    with path.open("r+b") as file:
        file.seek(at)
        file.write(content)


@pytest.mark.parametrize("at", [0, 4096])
def test_a_damaged_file_is_set_aside_and_named(tmp_path: Path, at: int) -> None:
    path = tmp_path / "a.sqlite"
    with closing(opened(path)) as store:
        put(store, "one")
    damaged(path, at)
    with closing(opened(path)) as store:
        assert words(store) == []
        (damage,) = store.damages
        (aside,) = tmp_path.glob("a.sqlite.damaged-*Z")
        assert aside.name in damage
        put(store, "two")
    with closing(opened(path)) as store:
        assert (words(store), store.damages) == (["two"], [])


def test_what_can_be_read_of_a_damaged_file_is_saved(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    many = [f"{number} {'x' * 500}" for number in range(500)]
    with closing(opened(path)) as store:
        put(store, *many)
    damaged(path, path.stat().st_size // 2 // 4096 * 4096)
    with closing(opened(path)) as store:
        saved = words(store)
        assert (len(store.damages), saved) == (1, [word for word in many if word in saved])
        assert {*many[:100], *many[-100:]} <= set(saved)


@pytest.mark.parametrize("content", [b"", b"notes", b"\0" * 8192])
def test_a_file_that_is_none_of_ours_is_set_aside(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.sqlite"
    path.write_bytes(content)
    with closing(opened(path)) as store:
        put(store, "one")
    (aside,) = tmp_path.glob("a.sqlite.damaged-*")
    assert aside.read_bytes() == content


def test_damage_while_it_is_in_use_is_met(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with closing(opened(path)) as store:
        put(store, *("x" * 500 for _ in range(500)))
        with closing(sqlite3.connect(path)) as other:
            other.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        damaged(path, 8192, b"\xff" * 200_000)
        with pytest.raises(StoreFailedError):
            words(store)
        assert store.problem
        put(store, "after")
        assert not store.problem
        assert (words(store)[-1], len(store.damages)) == ("after", 1)


def test_a_file_that_cannot_be_read_is_waited_for_and_never_replaced(tmp_path: Path) -> None:
    path, elsewhere = tmp_path / "a.sqlite", tmp_path / "elsewhere"
    with closing(opened(path)) as store:
        put(store, "one")
    path.rename(elsewhere)
    path.mkdir()
    with closing(opened(path)) as store:
        for use in (words, put):
            with pytest.raises(StoreFailedError, match=r"a\.sqlite: Is a directory"):
                use(store)
        assert store.problem
        path.rmdir()
        elsewhere.rename(path)
        assert (words(store), store.damages) == (["one"], [])
        assert list(tmp_path.glob("*damaged*")) == []


def test_a_busy_file_is_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("edge_service.health.store.store._BUSY_S", 0.01)
    path = tmp_path / "a.sqlite"
    with closing(opened(path)) as store:
        put(store, "one")
        other = sqlite3.connect(path)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreFailedError, match="locked"):
            put(store, "two")
        assert words(store) == ["one"]
        other.close()
        put(store, "two")
        assert words(store) == ["one", "two"]


def test_a_full_disk_loses_nothing_and_is_written_to_again(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with closing(opened(path)) as store:
        put(store, "one")
        pages = store.write(lambda file: file.execute("PRAGMA page_count").fetchone()[0])
        store.write(lambda file: file.execute(f"PRAGMA max_page_count = {pages}").fetchone())
        with pytest.raises(StoreFailedError, match="full"):
            put(store, *("x" * 4000 for _ in range(10)))
        assert words(store) == ["one"]
        store.write(lambda file: file.execute("PRAGMA max_page_count = 100000").fetchone())
        put(store, "two")
        assert words(store) == ["one", "two"]


def test_two_stores_share_a_file_and_see_its_successor(tmp_path: Path) -> None:
    path, restored = tmp_path / "state" / "a.sqlite", tmp_path / "restored"
    restored.mkdir()
    with closing(opened(path)) as one, closing(opened(path)) as other:
        put(one, "one")
        put(other, "two")
        assert words(one) == words(other) == ["one", "two"]
        one.copy_to(restored / "a.sqlite")
        put(one, "late")
        path.parent.rename(tmp_path / "old")
        restored.rename(path.parent)
        assert words(one) == words(other) == ["one", "two"]
        assert one.damages == other.damages == []


def test_a_file_that_is_removed_while_in_use_is_begun_anew(tmp_path: Path) -> None:
    path = tmp_path / "a.sqlite"
    with closing(opened(path)) as store:
        put(store, "one")
        path.unlink()
        put(store, "two")
        assert words(store) == ["two"]
        assert store.damages == [f"{path}: it is gone; begun anew with what can be read"]


def test_a_disk_that_is_away_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "state" / "a.sqlite"
    with closing(opened(path)) as store:
        put(store, "one")
        store._device += 1
        path.unlink()
        with pytest.raises(StoreFailedError, match="its disk is away"):
            put(store, "two")
        assert not path.exists()


def test_many_who_add_and_revoke_at_once_lose_nothing(tmp_path: Path) -> None:
    path = tmp_path / "edge-service.sqlite"
    for number in range(4):
        Tokens(Store(path)).add(f"old {number}", "viewer", 0)

    def change(number: int) -> str:
        tokens = Tokens(Store(path))  # as a process of its own has it
        if number % 2:
            tokens.revoke(f"old {number // 2}")
        return tokens.add(f"new {number}", "operator", number)

    with ThreadPoolExecutor(8) as many:
        secrets = list(many.map(change, range(8)))
    there = Tokens(Store(path)).all()
    assert [each.name for each in there] == [f"new {number}" for number in range(8)]
    found = [token_of(secret, there) for secret in secrets]
    assert [each and each.name for each in found] == [f"new {number}" for number in range(8)]
    content = b"".join(part.read_bytes() for part in tmp_path.iterdir())
    assert not any(secret.encode() in content for secret in secrets)
    assert path.stat().st_mode & 0o007 == 0


@pytest.mark.parametrize("name", ["", " a", "a/b", "a" * 61, "a\n"])
def test_a_name_that_makes_no_sense_is_refused(name: str) -> None:
    with pytest.raises(TokenError, match="expected up to 60 letters"):
        Tokens(Store(None)).add(name, "viewer", 0)


def test_names_are_taken_once_and_revoked_once() -> None:
    tokens = Tokens(Store(None))
    secret = tokens.add("Kim", "viewer", 7)
    with pytest.raises(TokenError, match="there is a token named 'Kim'"):
        tokens.add("Kim", "operator", 8)
    tokens.revoke("Kim")
    with pytest.raises(TokenError, match="no token is named 'Kim'; there are: none"):
        tokens.revoke("Kim")
    assert token_of(secret, tokens.all()) is None


def test_only_a_lost_file_or_table_keeps_an_open_page_shut(tmp_path: Path) -> None:
    path = tmp_path / "edge-service.sqlite"
    store = Store(path)
    tokens, log = Tokens(store), EventLog(store)
    log.add([event_of()], 1)
    store.write(lambda file: file.execute("UPDATE events SET body = '{'"))
    assert (log.after(0, 10), store.damages) == ([], ["event 1 is damaged and left out"])
    assert not tokens.may_be_lost
    tokens.add("Kim", "operator", 1)
    store.write(lambda file: file.execute("UPDATE tokens SET hash = 'x'"))
    assert tokens.all() == ()
    assert tokens.may_be_lost
    store.close()
    path.write_bytes(b"notes")
    again = Tokens(Store(path))
    assert again.all() == ()
    assert again.may_be_lost
