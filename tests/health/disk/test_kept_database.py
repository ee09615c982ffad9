"""An SQLite file that is killed, filled, damaged, replaced and removed."""

import random
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from edge_service.health.events.audit import read_audit
from edge_service.health.events.diary import Diary
from edge_service.kept_copy import PERIOD_S as COPY_PERIOD_S

from ..diaries import START_NS, event, numbers
from ..test_audit import entry

EVER = 2**62
SEED = 1


def all_of(diary: Diary) -> list[int]:
    return numbers(diary.between(0, EVER, "X", 10**6))


def filled(path: Path, count: int = 200) -> None:
    """A diary with events and entries, closed in good order, with its copy."""
    with closing(Diary(path)) as diary:
        diary.add([event(n) for n in range(count)], START_NS, [entry(n) for n in range(20)])
        diary.care(1e9)
        diary.add([event(count)], START_NS)


def looked_at(path: Path) -> tuple[list[int], Diary]:
    """Start on a diary, let it look at itself, and close it; what it holds."""
    with closing(Diary(path)) as diary:
        for _ in range(3):
            diary.care(1e9 + 1.0)
        found = all_of(diary)
        diary.add([event(10_000)], START_NS)
        assert all_of(diary) == [*found, 10_000]
        assert not diary.problem
        return found, diary


@pytest.mark.parametrize("spoiled", ["empty", "zeros", "text", "folder", "half", "gone", "other"])
def test_a_spoiled_file_is_set_aside_and_comes_back_from_the_copy(
    spoiled: str, tmp_path: Path
) -> None:
    path = tmp_path / "diary.sqlite"
    filled(path)
    content = path.read_bytes()
    path.unlink()
    if spoiled == "folder":
        path.mkdir()
    elif spoiled == "other":
        with closing(sqlite3.connect(path)) as file:
            file.execute("CREATE TABLE foreign_one (x)")
    elif spoiled != "gone":
        kinds = {"empty": b"", "zeros": bytes(len(content)), "text": b"[]", "half": content[:9000]}
        path.write_bytes(kinds[spoiled])
    found, diary = looked_at(path)
    assert found[:200] == list(range(200))
    assert len(diary.damages) == 1
    assert (path.with_name("diary.sqlite.damaged").exists()) == (spoiled != "gone")
    assert len(read_audit(path)) == 20


def test_no_flipped_bit_is_served_and_each_that_matters_is_named(tmp_path: Path) -> None:
    """What is lost by a bit is a row; a page of them comes back from the copy."""
    rng, base = random.Random(SEED), tmp_path / "base" / "diary.sqlite"
    filled(base)
    whole = list(range(201))
    for trial in range(60):
        path = tmp_path / f"{trial}" / "diary.sqlite"
        shutil.copytree(base.parent, path.parent)
        content = bytearray(path.read_bytes())
        content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        path.write_bytes(content)
        found, diary = looked_at(path)
        assert set(found) <= set(whole)
        if found != whole:
            assert len(diary.damages) >= 1
            assert len(whole) - len(found) <= 1
        shutil.rmtree(path.parent)


@pytest.mark.parametrize("column", ["axis", "room", "time_ns"])
def test_an_event_that_could_not_be_found_is_found_again(column: str, tmp_path: Path) -> None:
    path = tmp_path / "diary.sqlite"
    filled(path, 5)
    with closing(sqlite3.connect(path)) as file:
        file.execute(f"UPDATE events SET {column} = 0 WHERE id % 2")
        file.commit()
    found, diary = looked_at(path)
    assert found == list(range(6))
    assert diary.damages


def test_a_damaged_copy_is_named_and_made_anew(tmp_path: Path) -> None:
    path = tmp_path / "diary.sqlite"
    filled(path)
    copy = tmp_path / "diary.copy.sqlite"
    content = bytearray(copy.read_bytes())
    content[-3] ^= 1
    copy.write_bytes(content)
    found, diary = looked_at(path)
    assert found == list(range(201))
    assert len(diary.damages) == 1
    with closing(sqlite3.connect(copy)) as file:
        assert file.execute("PRAGMA integrity_check").fetchone() == ("ok",)


@pytest.mark.parametrize("how", ["removed", "replaced"])
def test_a_file_that_goes_while_it_is_used_is_begun_anew(how: str, tmp_path: Path) -> None:
    path, other = tmp_path / "diary.sqlite", tmp_path / "other.sqlite"
    filled(other, 3)
    with closing(Diary(path)) as diary:
        diary.add([event(1)], START_NS)
        path.unlink()
        if how == "replaced":
            other.replace(path)
        diary.add([event(2)], START_NS)
        assert 2 in all_of(diary)
    with closing(Diary(path)) as again:
        assert 2 in all_of(again)


def test_a_file_that_is_damaged_while_it_is_used_is_begun_anew(tmp_path: Path) -> None:
    path = tmp_path / "diary.sqlite"
    filled(path)
    with closing(Diary(path)) as diary:
        path.write_bytes(b"x" * path.stat().st_size)
        diary.care(1e9 + 2.0 * COPY_PERIOD_S)
        for number in (301, 302):
            diary.add([event(number)], START_NS)
        assert all_of(diary) == [*range(200), 301, 302]
        assert not diary.problem
        assert len(diary.damages) == 1


_WRITER = """
import sys
from pathlib import Path
sys.path[:0] = [{root!r}]
from edge_service.health.events.diary import Diary
from edge_service.kept_copy import PERIOD_S as COPY_PERIOD_S
from tests.health.diaries import START_NS, event
diary = Diary(Path({path!r}))
for number in range({first}, 10**9):
    diary.add([event(number)], START_NS)
    assert not diary.problem
    print(number, flush=True)
"""


@pytest.mark.slow
def test_a_killed_writer_has_lost_nothing_that_it_told_and_doubled_nothing(tmp_path: Path) -> None:
    path, root, rng = tmp_path / "diary.sqlite", str(Path(__file__).parents[3]), random.Random(SEED)
    told, first = [], 0
    for _ in range(20):
        code = _WRITER.format(root=root, path=str(path), first=first)
        with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            for _line in range(rng.randrange(1, 60)):
                told.append(int(process.stdout.readline()))
            process.kill()
            told += [int(line) for line in process.stdout.read().split(b"\n")[:-1]]
        first = told[-1] + 2
        with closing(Diary(path)) as diary:
            found = all_of(diary)
            assert set(told) <= set(found)
            assert len(set(found)) == len(found)
            assert not diary.damages
