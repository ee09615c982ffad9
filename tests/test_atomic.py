"""Files appear whole or not at all, and are on the disk then."""

import errno
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from edge_service.atomic import PRIVATE, replaced_bytes, replaced_file


def test_a_file_appears_with_its_folder(tmp_path: Path) -> None:
    target = tmp_path / "new" / "file.txt"
    with replaced_file(target) as file:
        file.write("whole")
        assert not target.exists()
    assert target.read_text() == "whole"
    assert [path.name for path in target.parent.iterdir()] == ["file.txt"]


def test_a_failure_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "file.txt"
    target.write_text("old")
    with pytest.raises(RuntimeError), replaced_file(target) as file:
        file.write("half")
        raise RuntimeError
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["file.txt"]


def test_a_device_is_not_replaced(tmp_path: Path) -> None:
    os.mkfifo(pipe := tmp_path / "pipe")
    with pytest.raises(FileExistsError), replaced_file(pipe):
        pass
    assert pipe.is_fifo()


@pytest.mark.parametrize("old", [None, 0o644])
def test_a_secret_is_for_its_owner_alone_from_first_byte(tmp_path: Path, old: int | None) -> None:
    target = tmp_path / "secret"
    if old is not None:
        target.touch(old)
    with replaced_file(target, PRIVATE) as file:
        file.write("secret")
        (part,) = set(tmp_path.iterdir()) - {target}
        assert part.stat().st_mode & 0o777 == PRIVATE
    assert target.stat().st_mode & 0o777 == PRIVATE


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_what_root_writes_belongs_to_who_had_it(tmp_path: Path) -> None:
    target = tmp_path / "tokens"
    target.touch()
    os.chown(target, 4711, 4712)
    with replaced_file(target, PRIVATE) as file:
        file.write("new")
    assert (target.stat().st_uid, target.stat().st_gid) == (4711, 4712)
    _written(replaced_file, tmp_path / "first", "new")
    assert (tmp_path / "first").stat().st_uid == 0
    tmp_path.chmod(0o777)  # another may have put it there, to have what root writes
    _written(replaced_file, target, "new")
    assert target.stat().st_uid == 0


WRITERS: list[Callable[[Path], None]] = [
    lambda path: _written(replaced_file, path, "text"),
    lambda path: _written(replaced_bytes, path, b"bytes"),
]


def _written(writer: Callable, path: Path, content: str | bytes) -> None:
    with writer(path) as file:
        file.write(content)


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("mask", [0o022, 0o027, 0o077])
def test_all_kept_files_have_the_mode_of_the_umask(tmp_path: Path, write: Callable, mask: int):
    before = os.umask(mask)
    try:
        write(tmp_path / "file")
    finally:
        os.umask(before)
    assert (tmp_path / "file").stat().st_mode & 0o777 == 0o666 & ~mask


@pytest.mark.parametrize("write", WRITERS)
def test_content_is_on_the_disk_before_the_name_and_the_name_at_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write: Callable
) -> None:
    target, done = tmp_path / "new" / "file", []
    sync, replace = os.fsync, os.replace

    def note_sync(handle: int) -> None:
        done.append(Path(f"/proc/self/fd/{handle}").readlink())
        sync(handle)

    def note_replace(source: Path, place: Path) -> None:
        done.append(place)
        replace(source, place)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", note_replace)
    write(target)
    made, part, place, folder = done
    assert (made, place, folder) == (tmp_path, target, target.parent)
    assert part.parent == target.parent
    assert part != target


@pytest.mark.parametrize("name", ["open", "fsync", "replace"])
def test_what_fails_is_raised_and_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    target = tmp_path / "file"
    _written(replaced_file, target, "1")

    def full(path: object, *_: object) -> None:
        named = (str(path),) if isinstance(path, Path) else ()
        raise OSError(errno.ENOSPC, "No space left on device", *named)

    monkeypatch.setattr(os, name, full)
    with pytest.raises(OSError, match=f"space.*'{target}'"):
        _written(replaced_file, target, "2")
    monkeypatch.undo()
    assert target.read_text() == "1"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
