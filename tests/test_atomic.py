"""Files appear whole or not at all."""

from pathlib import Path

import pytest

from edge_service.atomic import replaced_file


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
