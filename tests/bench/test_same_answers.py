"""Answers are compared byte by byte, and one that is missing differs."""

from pathlib import Path

from .same_answers import differing


def written(folder: Path, **answers: str) -> Path:
    folder.mkdir()
    for name, text in answers.items():
        (folder / name.replace("_", ".")).write_text(text)
    return folder


def test_equal_answers_do_not_differ(tmp_path: Path) -> None:
    before = written(tmp_path / "before", a_json="{}", b_html="old")
    after = written(tmp_path / "after", a_json="{}", b_html="new")
    assert differing(before, after) == []


def test_other_and_missing_answers_differ(tmp_path: Path) -> None:
    before = written(tmp_path / "before", a_json="{}", b_csv="1", c_txt="x")
    after = written(tmp_path / "after", a_json="{ }", b_csv="1", d_toml="")
    assert differing(before, after) == ["a.json", "c.txt", "d.toml"]
