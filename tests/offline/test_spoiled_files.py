"""Spoiled files of every kind, read by the commands: one line and status 2, or an answer."""

import random
from pathlib import Path

import pytest

from ..recordings.form_files import RIGHT
from .spoiled_files import KINDS, answer_to, command_on, right_files, spoiled

COUNT = 30
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def right() -> dict:
    return right_files()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the machine files that configurations name."""
    for path in (ROOT / "deploy").glob("*.toml"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def test_every_form_of_a_recording_is_spoiled(right) -> None:
    contents = {content for each in right.values() for content in each}
    assert all(set(make()) <= contents for make in RIGHT.values())


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_spoiled_is_read_or_refused_in_one_line(kind: str, folder: Path, right) -> None:
    for seed in range(COUNT):
        chance = random.Random(f"{kind} {seed}")
        content = spoiled(chance.choice(right[kind]), chance)
        assert answer_to(command_on(kind, content, folder)) in ("", "refused"), f"{kind} {seed}"


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_right_is_read(kind: str, folder: Path, right) -> None:
    """The first of each kind; others ask for a file beside them, or for a driver's own keys."""
    assert answer_to(command_on(kind, right[kind][0], folder)) == ""


DEEP = (b"a = " + b"[" * 50_000, b"[a" + b".a" * 50_000 + b"]", b"<traceSession>" + b"<a>" * 50_000)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("content", DEEP, ids=("lists", "tables", "tags"))
def test_what_is_nested_deeply_is_refused_in_one_line(kind: str, content: bytes, folder) -> None:
    assert answer_to(command_on(kind, content, folder)) in ("", "refused")
