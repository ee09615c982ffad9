"""What a service is configured by is told by the content of its files alone."""

import json
from pathlib import Path

import pytest

from edge_service.config import ConfigurationIdentity, EdgeConfig, load_config

CONFIG = '[service]\nmachine = "mill"\n[[axes]]\nname = "X"\nmachine = "machines/x.toml"\n'
MACHINE = (Path(__file__).parents[1] / "deploy" / "machine.toml").read_text()


def installed(folder: Path, name: str = "edge.toml") -> Path:
    """A configuration and its machine file."""
    (folder / "machines").mkdir(parents=True)
    (folder / "machines/x.toml").write_text(MACHINE)
    (folder / name).write_text(CONFIG)
    return folder / name


def test_equal_files_have_equal_digests_wherever_they_lie(tmp_path: Path) -> None:
    one = load_config(installed(tmp_path / "a")).identity
    other = load_config(installed(tmp_path / "b", "mill.toml")).identity
    assert one == other
    assert len(one.digest) == 12
    assert one.bundle is None


@pytest.mark.parametrize("name", ["edge.toml", "machines/x.toml"])
def test_a_changed_file_changes_the_digest(tmp_path: Path, name: str) -> None:
    config = installed(tmp_path)
    before = load_config(config).identity
    with (tmp_path / name).open("a") as file:
        file.write("# changed\n")
    assert load_config(config).identity != before


def put_in_place(config: Path, **changes: object) -> None:
    """Describe the present state as that of bundle 7."""
    folder = config.with_name("edge.toml.rollout") / "current"
    folder.mkdir(parents=True)
    described = {
        "number": 7,
        "site": "bench",
        "machine": "mill",
        "made": "2026-01-01T00:00:00+00:00",
        "made_by": "0.1.0",
        "configuration": load_config(config).identity.digest,
        "signer": "",
        "files": {},
        "before": "",
    }
    (folder / "applied.json").write_text(json.dumps(described | changes))


def test_the_bundle_is_named_while_its_files_are_in_place(tmp_path: Path) -> None:
    config = installed(tmp_path)
    put_in_place(config, of_a_later_version=True)
    identity = load_config(config).identity
    assert identity.bundle == 7
    assert identity.words == f"{identity.digest} (bundle 7)"
    (tmp_path / "machines/x.toml").write_text(MACHINE + "# changed here\n")
    assert load_config(config).identity.bundle is None


@pytest.mark.parametrize("content", ["", "{}", "[1]", "\x00"])
def test_a_damaged_description_names_no_bundle(tmp_path: Path, content: str) -> None:
    config = installed(tmp_path)
    put_in_place(config)
    (tmp_path / "edge.toml.rollout/current/applied.json").write_text(content)
    assert load_config(config).identity.bundle is None


def test_what_was_read_from_no_file_has_no_digest() -> None:
    identity = EdgeConfig.model_validate({"axes": [{"name": "X"}]}).identity
    assert identity == ConfigurationIdentity()
    assert identity.words == ""


def test_a_copy_of_a_configuration_keeps_its_identity(tmp_path: Path) -> None:
    settings = load_config(installed(tmp_path))
    copied = settings.model_copy(update={"http": settings.http.model_copy(update={"port": 9})})
    assert copied.identity == settings.identity
