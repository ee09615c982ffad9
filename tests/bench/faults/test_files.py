"""Spoiled files of every kind, read by the commands: the short form of the benchmark."""

import random
from pathlib import Path

import pytest

from tests.recordings.form_files import RIGHT

from .files import KINDS, problem_of, spoil
from .hostile_files import right_files, spoiled

COUNT = 40


@pytest.fixture(scope="module")
def right() -> dict:
    """Right contents by kind."""
    return right_files()


def test_every_form_of_a_recording_is_spoiled(right) -> None:
    contents = {content for each in right.values() for content in each}
    assert all(set(make()) <= contents for make in RIGHT.values())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the machine files that configurations name."""
    for path in (Path(__file__).parents[3] / "deploy").glob("*.toml"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_spoiled_is_read_or_refused_in_one_line(kind: str, folder: Path, right) -> None:
    for seed in range(1000, 1000 + COUNT):
        arguments = spoil(kind, seed, right[kind], folder)
        assert problem_of(arguments) == "", f"{kind} {seed}"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_right_is_read(kind: str, folder: Path, right, monkeypatch) -> None:
    monkeypatch.setattr("tests.bench.faults.files.spoiled", lambda content, _chance: content)
    for content in right[kind]:
        assert problem_of(spoil(kind, 1, [content], folder)) == ""


DEEP = (b"a = " + b"[" * 50_000, b"[a" + b".a" * 50_000 + b"]", b"<traceSession>" + b"<a>" * 50_000)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("content", DEEP, ids=("lists", "tables", "tags"))
def test_what_is_nested_deeply_is_refused_in_one_line(kind, content, folder, monkeypatch) -> None:
    monkeypatch.setattr("tests.bench.faults.files.spoiled", lambda content, _chance: content)
    assert problem_of(spoil(kind, 1, [content], folder)) == ""


def test_the_same_seed_spoils_alike_and_another_otherwise() -> None:
    content = bytes(range(200))
    first, again, other = (spoiled(content, random.Random(seed)) for seed in (1, 1, 2))
    assert first == again != other
