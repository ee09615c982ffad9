"""Damage of every kind of file of the history: nothing wrong is served, and it is told."""

import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from edge_service.atomic import DAMAGED
from edge_service.health.history.archive import AxisArchive
from edge_service.health.history.parquet import to_table
from edge_service.health.history.record import RECORD_BYTES, record_of, scan

from .conftest import HOURS, NS, START_S, TIMES_S, append, check_rows, estimate, kept_history

BITS = 12
Spoiler = Callable[[Path, random.Random], None]


def _flip(path: Path, rng: random.Random) -> None:
    content = bytearray(path.read_bytes())
    content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    path.write_bytes(content)


def _cut(path: Path, rng: random.Random) -> None:
    size = path.stat().st_size
    length = rng.randrange(1, size)
    path.write_bytes(path.read_bytes()[: length + (length % RECORD_BYTES == 0)])


def _zero(path: Path, rng: random.Random) -> None:
    content = bytearray(path.read_bytes())
    start = rng.randrange(len(content))
    length = min(512, len(content) - start)
    content[start : start + length] = b"\xaa" + bytes(length - 1)
    path.write_bytes(content)


def _garbage(path: Path, rng: random.Random) -> None:
    path.write_bytes(rng.randbytes(rng.randrange(200, 9000)))


def _empty(path: Path, _: random.Random) -> None:
    path.write_bytes(b"")


def _folder(path: Path, _: random.Random) -> None:
    path.unlink()
    path.mkdir()


def _loop(path: Path, _: random.Random) -> None:
    path.unlink()
    path.symlink_to(path.name)


SPOILERS: dict[str, Spoiler] = {
    spoil.__name__.strip("_"): spoil
    for spoil in (_flip, _cut, _zero, _garbage, _empty, _folder, _loop)
}


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kept") / "axis=X"
    kept_history(folder)
    return folder


def kinds(folder: Path) -> dict[str, Path]:
    """One file of each kind that the history keeps: of each folder and ending."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {f"{path.parent.name}/{path.suffix}": path.relative_to(folder) for path in files}


def test_the_kinds_are_known(kept: Path) -> None:
    assert set(kinds(kept)) == {"axis=X/.log", "raw/.parquet", "minute/.parquet", "hour/.parquet"}


@pytest.mark.parametrize(
    "kind", ["axis=X/.log", "raw/.parquet", "minute/.parquet", "hour/.parquet"]
)
@pytest.mark.parametrize("how", SPOILERS)
def test_damage_is_told_and_never_served(kept: Path, tmp_path: Path, kind: str, how: str) -> None:
    rng = random.Random(f"{kind} {how}")
    for number in range(BITS if how == "flip" else 2):
        folder = tmp_path / str(number)
        shutil.copytree(kept, folder)
        path = folder / kinds(kept)[kind]
        SPOILERS[how](path, rng)
        archive = AxisArchive(folder)
        found = check_rows(archive)
        told = archive.take_damages()
        if (kind, how) != ("axis=X/.log", "empty"):  # as after a compaction
            assert any(str(path) in words for words in told), (number, told)
        lost = set(TIMES_S.tolist()) - found[3600.0]
        assert kind != "axis=X/.log" or len(found[1.0]) >= TIMES_S.size - 30
        assert kind == "axis=X/.log" or not lost or kind == "hour/.parquet"
        _goes_on(archive, folder)


def _goes_on(archive: AxisArchive, folder: Path) -> None:
    """What comes afterwards is kept, once, and the damage is not told again."""
    append(archive, TIMES_S[-1])
    archive.flush(sync=True)
    for _ in range(5):
        archive.mend()
    again = AxisArchive(folder)
    again.flush()
    assert again.take_damages() == []
    found = check_rows(again)
    assert TIMES_S[-1] in found[1.0]
    assert found[3600.0] >= found[60.0] >= found[1.0]


def test_a_damaged_file_is_found_before_anybody_asks(kept: Path, tmp_path: Path) -> None:
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    path = sorted((tmp_path / "raw").iterdir())[0]
    _flip(path, random.Random(3))
    archive = AxisArchive(tmp_path)
    for tier, each in archive.files():
        archive.check(tier, each)
    (told,) = archive.take_damages()
    assert str(path) in told
    assert [each.name for each in (tmp_path / "raw").iterdir() if each.suffix == DAMAGED] == [
        f"{path.name}{DAMAGED}"
    ]


@pytest.mark.parametrize("kind", ["minute", "hour"])
def test_coarser_rows_are_made_anew_from_finer_ones(kept: Path, tmp_path: Path, kind: str) -> None:
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    before = check_rows(AxisArchive(tmp_path))
    for path in (tmp_path / kind).iterdir():
        _garbage(path, random.Random(1))
    archive = AxisArchive(tmp_path)
    check_rows(archive)
    for _ in range(40):
        archive.mend()
    assert check_rows(AxisArchive(tmp_path)) == before


def test_what_cannot_be_set_aside_is_told_once_and_stays(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    path = sorted((tmp_path / "raw").iterdir())[0]
    _garbage(path, random.Random(1))

    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("os.replace", refuse)
    archive = AxisArchive(tmp_path)
    for _ in range(3):
        check_rows(archive)
    assert len(archive.take_damages()) == 1
    assert path.exists()


@pytest.mark.parametrize("tier", ["raw", "minute", "hour"])
def test_files_of_an_earlier_version_are_read_doubted_and_sealed(
    kept: Path, tmp_path: Path, tier: str
) -> None:
    import pyarrow.parquet as pq

    shutil.copytree(kept, tmp_path, dirs_exist_ok=True)
    archive = AxisArchive(tmp_path)
    for each, path in archive.files():
        if each.resolution.name == tier:
            rows = each.read(START_S, START_S + 366 * 86400.0)
            mine = rows.between(*each._span(path))
            pq.write_table(to_table(mine), path, compression="zstd")
    old = AxisArchive(tmp_path)
    before = check_rows(old)
    for each, path in old.files():
        old.check(each, path)
    assert old.adopted == sum(path.parent.name == tier for _, path in old.files())
    assert old.take_damages() == []
    assert check_rows(AxisArchive(tmp_path)) == before
    contradictory = sorted((tmp_path / tier).iterdir())[0]
    table = pq.read_table(contradictory)
    pq.write_table(table.replace_schema_metadata(None).take([1, 0]), contradictory)
    doubted = AxisArchive(tmp_path)
    check_rows(doubted)
    assert "contradicts" in doubted.take_damages()[0]


def test_the_sealed_files_are_plain_parquet(kept: Path) -> None:
    import pyarrow.parquet as pq

    (hour,) = (kept / "hour").iterdir()
    assert len(pq.read_table(hour)) == HOURS + 1


def test_records_are_found_behind_damage_of_any_length() -> None:
    rng = random.Random(5)
    records = [record_of(each * NS, estimate(float(each))) for each in range(40)]
    for _ in range(100):
        holes = rng.sample(range(39), 3)
        parts = list(records)
        for hole in holes:
            parts[hole] = rng.randbytes(rng.randrange(1, 300))
        good = [part for number, part in enumerate(parts) if number not in holes]
        found = scan(b"".join(parts) + b"\x01" * 7)
        assert found.records == b"".join(good)
        assert found.torn_bytes == 7
        assert found.damaged_bytes == sum(len(parts[number]) for number in holes)
