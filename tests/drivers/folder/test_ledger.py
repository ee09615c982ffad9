"""The ledger on disks that are full, gone or damaged: reading goes on, and is not done twice."""

import errno
import json
import os
import random
from pathlib import Path

import pytest

from drivers.base import DriverUnavailableError
from drivers.folder import ledger as ledger_module
from drivers.folder.ledger import MOST_BEGINNINGS, Entry, Ledger

NUMBERS = (errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EIO, errno.EDQUOT)


def _digest(number: int) -> str:
    return f"{number:064x}"


def _written(path: Path, count: int = 20) -> Ledger:
    ledger = Ledger(path)
    for number in range(count):
        ledger.entry(_digest(number), f"{number}.csv", 10 + number).done = True
    ledger.save()
    return ledger


def _known(ledger: Ledger) -> set[str]:
    return set(ledger._entries)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / ".edge-service-X.json"


def test_what_was_written_is_there_again(path: Path) -> None:
    assert _known(Ledger(path)) == set()
    assert Ledger(path).unsaved == 0
    assert Ledger(path)._entries == {}
    _written(path)
    assert Ledger(path)._entries[_digest(3)] == Entry(_digest(3), "3.csv", done=True, size=13)


def test_a_ledger_of_the_version_before_is_read(path: Path) -> None:
    path.write_text(json.dumps([{"digest": _digest(1), "name": "a", "done": True}], indent=1))
    assert _known(Ledger(path)) == {_digest(1)}


@pytest.mark.parametrize("number", NUMBERS)
def test_what_cannot_be_written_is_told_once_and_written_later(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, number: int
) -> None:
    ledger = _written(path, 1)

    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as refusing:
        refusing.setattr(ledger_module, "write_checked", refuse)
        ledger.entry(_digest(9), "9.csv", 1).done = True
        ledger.save()
        ledger.save()
    assert (ledger.unsaved, caplog.text.count("cannot be written")) == (2, 1)
    assert _known(Ledger(path)) == {_digest(0)}
    ledger.save()
    assert ledger.unsaved == 0
    assert _known(Ledger(path)) == {_digest(0), _digest(9)}


@pytest.mark.parametrize("number", NUMBERS[2:])
def test_a_ledger_that_cannot_be_read_now_is_waited_for(
    path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def refuse(_path: Path) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(ledger_module, "read_checked", refuse)
    with pytest.raises(DriverUnavailableError, match="cannot be read"):
        Ledger(path)


def _damages() -> list[tuple[str, int]]:
    kinds = ("cut", "flip", "zeros", "garbage", "twice")
    return [(kind, seed) for kind in kinds for seed in range(8)]


@pytest.mark.parametrize(("kind", "seed"), _damages())
def test_damage_is_set_aside_and_what_is_whole_stands(path: Path, kind: str, seed: int) -> None:
    _written(path)
    content, chance = bytearray(path.read_bytes()), random.Random(seed)
    where = chance.randrange(len(content))
    if kind == "cut":
        del content[where:]
    elif kind == "flip":
        content[where] ^= 1 << chance.randrange(8)
    elif kind == "zeros":
        content[where : where + 400] = bytes(min(400, len(content) - where))
    elif kind == "garbage":
        content[where : where + 100] = chance.randbytes(100)
    else:
        content += content[:where]
    path.write_bytes(content)
    known = _known(Ledger(path))
    if content:
        assert len(list(path.parent.glob("*.damaged"))) == 1
    assert all(len(digest) == 64 for digest in known)
    whole = {_digest(number) for number in range(20) if _digest(number).encode() in content}
    assert len(known & {_digest(number) for number in range(20)}) >= min(len(whole), 20) - 4


def test_nothing_but_zeros_is_a_ledger_that_was_lost(path: Path) -> None:
    path.write_bytes(bytes(500))
    assert _known(Ledger(path)) == set()


def test_beginnings_of_a_file_that_grows_do_not_fill_the_ledger(path: Path) -> None:
    ledger = Ledger(path)
    for number in range(1, 100):
        beginnings = ledger.shorter("log.csv", number)
        ledger.entry(_digest(number), "log.csv", number)
        ledger.note_grown(beginnings)
    other = ledger.entry(_digest(200), "other.csv", 5)
    assert len(_known(ledger)) == MOST_BEGINNINGS + 2
    assert ledger.entry(_digest(200), "copy.csv", 5) is other
