"""Uploads: bounded while they come, cleaned up after, and blind to what is no recording."""

import asyncio
import os
from collections.abc import AsyncIterator

import pytest

from edge_service.http_api import recordings
from edge_service.http_api.recordings import Recordings, RefusedError

MB = 1 << 20


class _Upload:
    def __init__(self, kept: Recordings, name: str) -> None:
        self._chunks: asyncio.Queue[bytes] = asyncio.Queue()
        self.done = asyncio.create_task(kept.receive(name, self._come()))

    async def _come(self) -> AsyncIterator[bytes]:
        while chunk := await self._chunks.get():
            yield chunk

    def feed(self, *chunks: bytes) -> None:
        for chunk in chunks:
            self._chunks.put_nowait(chunk)


async def _refusal(upload: _Upload) -> int:
    with pytest.raises(RefusedError) as refused:
        await asyncio.wait_for(upload.done, 60.0)
    return refused.value.status_code


async def test_uploads_at_the_same_time_are_counted_together_as_they_grow(tmp_path):
    kept = Recordings(tmp_path / "new", 5 * MB)
    uploads = [_Upload(kept, f"{number}.csv") for number in range(3)]
    for upload in uploads:
        upload.feed(b"x" * MB)
    while len(list(kept.folder.glob(".*"))) < 3:
        await asyncio.sleep(0.001)
    uploads[0].feed(b"x" * MB, b"")
    assert (await uploads[0].done).bytes == 2 * MB
    uploads[1].feed(b"x" * MB, b"")
    assert (await uploads[1].done).bytes == 2 * MB
    uploads[2].feed(b"x" * MB)
    assert await _refusal(uploads[2]) == 507
    assert sorted(path.name for path in kept.folder.iterdir()) == ["0.csv", "1.csv"]
    kept.remove("0.csv")
    again = _Upload(kept, "2.csv")
    again.feed(b"x" * 2 * MB, b"")
    assert (await again.done).bytes == 2 * MB


async def test_room_on_the_disk_is_left_to_the_history(tmp_path, monkeypatch):
    monkeypatch.setattr(recordings, "LEFT_FREE_BYTES", 1 << 62)
    upload = _Upload(Recordings(tmp_path, 5 * MB), "a.csv")
    upload.feed(b"x", b"")
    assert await _refusal(upload) == 507
    assert list(tmp_path.iterdir()) == []


async def test_an_upload_that_breaks_off_leaves_nothing(tmp_path):
    kept = Recordings(tmp_path, 5 * MB)
    upload = _Upload(kept, "a.csv")
    upload.feed(b"x" * MB)
    while not list(tmp_path.glob(".*")):
        await asyncio.sleep(0.001)
    upload.done.cancel()
    with pytest.raises(asyncio.CancelledError):
        await upload.done
    assert list(tmp_path.iterdir()) == []


def test_leftovers_of_a_service_that_was_killed_are_removed_at_the_start(tmp_path):
    for name in (".a.csv.part123", ".b.parquet.0f.part", ".c.parquet.ab.partial"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "whole.csv").write_bytes(b"x")
    Recordings(tmp_path, MB)
    assert [path.name for path in tmp_path.iterdir()] == ["whole.csv"]


async def test_what_is_no_plain_file_is_no_recording(tmp_path):
    (tmp_path / "dangling.csv").symlink_to(tmp_path / "nowhere")
    (tmp_path / "loop.csv").symlink_to(tmp_path / "loop.csv")
    (tmp_path / "secret.csv").symlink_to("/etc/passwd")
    (tmp_path / "folder.csv").mkdir()
    os.mkfifo(tmp_path / "pipe.csv")
    kept = Recordings(tmp_path, MB)
    assert await kept.page(2**62, 100) == []
    for path in tmp_path.iterdir():
        with pytest.raises(RefusedError, match="there is no recording"):
            kept.path(path.name)
        with pytest.raises(RefusedError, match="there is no recording"):
            kept.remove(path.name)
