"""Digests: right for every file that changes in any way, and cheap for one that grows."""

import hashlib
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.folder.digests import MOST_FILES, Digests


def _sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_what_was_hashed_is_not_hashed_again(tmp_path: Path) -> None:
    digests, file, content = Digests(), tmp_path / "log.csv", b""
    for number in range(200):
        content += bytes([number]) * 10_000
        file.write_bytes(content)
        sizes = {len(content), *range(10_000, len(content), 10_000)}
        assert digests.of(file, sizes)[len(content)] == _sha(content)
    assert digests.hashed_bytes == len(content)


def test_the_first_look_at_a_file_hashes_it_once_for_all_its_beginnings(tmp_path: Path) -> None:
    file = tmp_path / "log.csv"
    file.write_bytes(bytes(100_000))
    digests = Digests()
    found = digests.of(file, {10, 50_000, 100_000})
    assert found == {size: _sha(bytes(size)) for size in (10, 50_000, 100_000)}
    assert digests.hashed_bytes == 100_000


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.tuples(st.sampled_from("agwrs"), st.binary(min_size=1, max_size=50)), max_size=8)
)
def test_digests_are_right_whatever_happens_to_a_file(tmp_path_factory, changes) -> None:
    file = tmp_path_factory.mktemp("one") / "a.csv"
    digests, content = Digests(), b"begin"
    for kind, some in changes:
        if kind == "a":
            content += some
        elif kind == "g":
            content += some * 200
        elif kind == "w":
            content = some
        elif kind == "s":
            content = content[: len(some)] or b"x"
        if kind == "r":
            file.unlink(missing_ok=True)
        file.write_bytes(content)
        sizes = {len(content), max(len(content) // 2, 1)}
        assert digests.of(file, sizes) == {size: _sha(content[:size]) for size in sizes}


def test_only_the_last_files_are_remembered(tmp_path: Path) -> None:
    digests = Digests()
    for number in range(MOST_FILES + 10):
        file = tmp_path / str(number)
        file.write_bytes(b"x")
        digests.of(file, {1})
    assert len(digests._hashed) == MOST_FILES
