"""Tokens of the store: changed by many at once, none of which loses what another did."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from edge_service.health.store.events import EventLog
from edge_service.health.store.store import Store
from edge_service.health.store.tokens import TokenError, Tokens, token_of
from tests.messages.examples import event_of


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
    assert log.after(0, 10) == []
    assert store.damages == ["event 1 is damaged and left out"]
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
