"""The service tells which program and which configuration it runs."""

from pathlib import Path

import pytest

from edge_service.config import load_config

from ..documents import ROOT

CONFIG = '[service]\nmachine = "mill"\n[[axes]]\nname = "X"\nmachine = "machines/x.toml"\n'


def installed(folder: Path, name: str = "edge.toml") -> Path:
    """A configuration and its machine file."""
    (folder / "machines").mkdir(parents=True)
    (folder / "machines/x.toml").write_text((ROOT / "deploy" / "machine.toml").read_text())
    (folder / name).write_text(CONFIG)
    return folder / name


def test_equal_files_have_equal_digests_wherever_they_lie(tmp_path: Path) -> None:
    one = load_config(installed(tmp_path / "a"))
    other = load_config(installed(tmp_path / "b", "mill.toml"))
    assert one.digest == other.digest == one.model_copy(update={"axes": ()}).digest
    assert len(one.digest) == 12


@pytest.mark.parametrize("name", ["edge.toml", "machines/x.toml"])
def test_a_changed_file_changes_the_digest(tmp_path: Path, name: str) -> None:
    config = installed(tmp_path)
    before = load_config(config).digest
    with (tmp_path / name).open("a") as file:
        file.write("# changed\n")
    assert load_config(config).digest != before
