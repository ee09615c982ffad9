"""The ledger on disks that are full, gone or damaged: reading goes on, and is not done twice."""

import errno
import os
import random
from pathlib import Path

import pytest

from drivers.base import DriverUnavailableError
from drivers.folder import driver as folder
from drivers.folder.driver import Ledger


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "ledger.json"


@pytest.fixture
def traces(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / f"{number}.csv" for number in range(20)]
    for number, each in enumerate(paths):
        each.write_text(f"{number}\n")
    return paths


def _written(path: Path, traces: list[Path]) -> Ledger:
    ledger = Ledger(path)
    for each in traces:
        ledger.entry_of(each).done = True
    ledger.save()
    return ledger


def _done(path: Path, traces: list[Path]) -> list[bool]:
    return [Ledger(path).entry_of(each).done for each in traces]


def _refuse(number: int) -> object:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    return refuse


def test_what_was_read_is_known_again_by_its_content(path: Path, traces: list[Path]) -> None:
    assert _done(path, traces) == [False] * 20
    _written(path, traces)
    assert _done(path, traces) == [True] * 20
    assert Ledger(path).entry_of(traces[3].rename(path.parent / "other")).done


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES])
def test_what_cannot_be_written_is_told_once_and_written_later(
    path: Path, traces: list[Path], number: int, monkeypatch, caplog: pytest.LogCaptureFixture
) -> None:
    ledger = _written(path, traces[:1])
    with monkeypatch.context() as refusing:
        refusing.setattr(folder, "replaced_file", _refuse(number))
        ledger.entry_of(traces[9]).done = True
        ledger.save()
        ledger.save()
    assert (ledger.unsaved, caplog.text.count("cannot be written")) == (2, 1)
    assert _done(path, [traces[0], traces[9]]) == [True, False]
    ledger.save()
    assert ledger.unsaved == 0
    assert _done(path, [traces[0], traces[9]]) == [True, True]


def test_a_ledger_that_cannot_be_read_now_is_waited_for(path: Path, monkeypatch) -> None:
    _written(path, [])
    monkeypatch.setattr(Path, "read_bytes", _refuse(errno.EIO))
    with pytest.raises(DriverUnavailableError, match="cannot be read"):
        Ledger(path)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("kind", ["cut", "flip", "zeros", "garbage", "twice"])
def test_of_a_damaged_ledger_what_is_whole_stands(
    path: Path, traces: list[Path], kind: str, seed: int
) -> None:
    _written(path, traces)
    content, chance = bytearray(path.read_bytes()), random.Random(seed)
    where = chance.randrange(1, len(content))
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
    done = _done(path, traces)
    whole = sum(b'"name": "%d.csv"' % number in content for number in range(20))
    assert sum(done) >= whole - 4


def test_a_damaged_ledger_is_kept_when_the_next_is_written(
    path: Path, traces: list[Path], monkeypatch, caplog: pytest.LogCaptureFixture
) -> None:
    _written(path, traces)
    damaged = path.read_bytes()[:-20]
    path.write_bytes(damaged)
    ledger = Ledger(path)
    with monkeypatch.context() as refusing:
        refusing.setattr(folder, "replaced_file", _refuse(errno.ENOSPC))
        ledger.save()
    assert path.read_bytes() == damaged
    ledger.save()
    ledger.save()
    (aside,) = path.parent.glob("ledger.json.damaged-*")
    assert aside.read_bytes() == damaged
    assert f"damaged, kept as {aside.name}" in caplog.text
    assert _done(path, traces) == [True] * 19 + [False]


def test_beginnings_of_a_file_that_grows_do_not_fill_the_ledger(path: Path) -> None:
    ledger, log = Ledger(path), path.with_name("log.csv")
    for rows in range(1, 60):
        log.write_text("1\n" * rows)
        entry = ledger.entry_of(log)
        assert entry.rows == rows - 1
        entry.rows, entry.done = rows, True
    ledger.save()
    assert path.read_text().count("log.csv") == 1
