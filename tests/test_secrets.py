"""Secrets come from files that nobody else can read, and are shown nowhere."""

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from drivers.base import driver_names, load_driver
from edge_service.config import ConfigError, EdgeConfig, check_settings, load_config
from edge_service.nodes.output_node import make_output
from edge_service.outputs.base import load_output
from edge_service.plugins import plugins
from edge_service.secret_files import SecretError, read_secret, secret_keys

OUTPUTS = plugins("edge_service.outputs")
MARKER = "marker-0f9c6a1e-4d2b"
SECRET_NAME = re.compile(r"password|secret|token|passphrase|credential", re.IGNORECASE)
AXIS = '[[axes]]\nname = "X"\n'


def tables(model: type[BaseModel], where: str = "") -> Iterator[tuple[str, type[BaseModel]]]:
    """Every table of a configuration with its dotted name."""
    yield where, model
    for name, field in model.model_fields.items():
        for each in (field.annotation, *get_args(field.annotation)):
            if isinstance(each, type) and issubclass(each, BaseModel):
                yield from tables(each, f"{where}.{name}".strip("."))


TABLES = [
    *tables(EdgeConfig),
    *((f"driver {name}", load_driver(name).config_model) for name in driver_names()),
    *((f"outputs.{name}", load_output(name).config_model) for name in OUTPUTS),
]
KEYS = [(where, model, key) for where, model in TABLES for key in secret_keys(model)]


def test_there_are_secrets_to_look_after() -> None:
    least = {("outputs.mqtt", "password"), ("driver opcua", "password")}
    assert {(where, key) for where, _, key in KEYS} >= least


@pytest.mark.parametrize(("where", "model"), TABLES, ids=str)
def test_what_sounds_like_a_secret_is_one_or_names_its_file(
    where: str, model: type[BaseModel]
) -> None:
    """A new key for a password cannot be a bare text."""
    secret = set(secret_keys(model))
    for name in model.model_fields:
        if SECRET_NAME.search(name):
            assert name in secret or name.endswith("_file"), f"{where}.{name}"
    for name in secret:
        assert f"{name}_file" in model.model_fields, f"{where}.{name}"


def config_file(folder: Path, where: str, lines: str) -> Path:
    path = folder / "edge.toml"
    path.write_text(f"[{where}]\n{lines}\n{AXIS}")
    path.chmod(0o600)
    return path


def complaint(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        make_output(load_config(path), "mqtt")
    assert "\n" not in str(caught.value)
    return str(caught.value)


MISTAKES = {
    "a list": f'[outputs.mqtt]\npassword = ["{MARKER}"]\nunknown_key = 1',
    "a table": f'[outputs.mqtt]\npassword = {{ a = "{MARKER}" }}\nunknown_key = 1',
    "a number": "[outputs.mqtt]\npassword = 90614117\nunknown_key = 1",
    "text that may not fit": f'[outputs.mqtt]\npassword = " {MARKER}"\nunknown_key = 1',
    "a list of tables": f'[[outputs.mqtt]]\npassword = "{MARKER}"',
    "a file as well": f'[outputs.mqtt]\npassword = "{MARKER}"\npassword_file = "held"',
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_in_a_secret_does_not_show_it(mistake: str, tmp_path: Path) -> None:
    for name, text in {"held": MARKER, "edge.toml": f"{MISTAKES[mistake]}\n{AXIS}"}.items():
        (tmp_path / name).touch(0o600)
        (tmp_path / name).write_text(text)
    told = complaint(tmp_path / "edge.toml")
    assert MARKER not in told
    assert "90614117" not in told
    both = "outputs.mqtt.password: there is password_file as well"
    assert (both in told) is (mistake == "a file as well")


@pytest.mark.parametrize(("where", "model", "key"), KEYS, ids=str)
def test_a_file_that_others_may_read_is_refused(
    where: str, model: type[BaseModel], key: str, tmp_path: Path
) -> None:
    held = tmp_path / "held"
    held.write_text(MARKER)
    held.chmod(0o644)
    if where.startswith("driver"):
        with pytest.raises(ConfigError) as refused:
            check_settings(model, {f"{key}_file": str(held)}, "axes.X.settings")
    else:
        path = config_file(tmp_path, where, f'{key}_file = "held"')
        with pytest.raises(ConfigError) as refused:
            make_output(load_config(path), where.partition(".")[2])
    said = f"{held}: others may read or change it (mode 644); chmod 600 {held}"
    assert said in str(refused.value)
    assert MARKER not in str(refused.value)


def test_files_are_relative_to_the_configuration_and_read(tmp_path: Path) -> None:
    (tmp_path / "p").write_text("hidden-part\n")
    (tmp_path / "p").chmod(0o600)
    lines = 'url = "mqtt://u@127.0.0.1"\npassword_file = "p"'
    config = load_config(config_file(tmp_path, "outputs.mqtt", lines))
    made = make_output(config, "mqtt").config
    assert made.password.get_secret_value() == "hidden-part"
    for shown in (repr(config), config.model_dump_json(), repr(made), made.model_dump_json()):
        assert "hidden-part" not in shown


def test_credentials_are_found_where_systemd_puts_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mqtt-password").write_text("pass")
    (tmp_path / "mqtt-password").chmod(0o400)
    lines = 'url = "mqtt://u@127.0.0.1"\npassword_file = "$CREDENTIALS_DIRECTORY/mqtt-password"'
    path = config_file(tmp_path, "outputs.mqtt", lines)
    monkeypatch.delenv("CREDENTIALS_DIRECTORY", raising=False)
    assert "$CREDENTIALS_DIRECTORY is not set" in complaint(path)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    made = make_output(load_config(path), "mqtt").config
    assert made.password.get_secret_value() == "pass"


@pytest.mark.parametrize(
    ("right", "root_owns", "mode"),
    [(True, False, mode) for mode in (0o400, 0o600)]
    + [(True, True, mode) for mode in (0o640, 0o440)]
    + [(False, mode != 0o640, mode) for mode in (0o640, 0o660, 0o604, 0o602, 0o601)],
)
def test_who_may_read_a_secret(mode: int, root_owns: bool, right: bool, tmp_path: Path) -> None:
    path = tmp_path / "held"
    path.write_text(MARKER)
    path.chmod(mode)
    if os.getuid() == 0:
        os.chown(path, 0 if root_owns else 12345, -1)
    elif root_owns and mode & 0o070:
        pytest.skip("only root can give a file to root")
    if right:
        assert read_secret(path) == MARKER
    else:
        with pytest.raises(SecretError, match=r"others may read or change it \(mode "):
            read_secret(path)


@pytest.mark.parametrize("content", [b"", b" \n", b"\xff\xfe", b"a" * 70_000])
def test_a_file_without_a_secret_is_told(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "held"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(SecretError, match="expected"):
        read_secret(path)


@pytest.mark.parametrize("kind", ["folder", "pipe", "nothing"])
def test_what_is_no_file_holds_up_nobody(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "held"
    make: dict[str, Any] = {"folder": Path.mkdir, "pipe": os.mkfifo}
    make.get(kind, lambda _: None)(path)
    with pytest.raises(SecretError, match="held: "):
        read_secret(path)


def test_a_secret_in_a_configuration_that_others_may_read_is_refused(tmp_path: Path) -> None:
    lines = f'url = "mqtt://u@127.0.0.1"\npassword = "{MARKER}"'
    path = config_file(tmp_path, "outputs.mqtt", lines)
    load_config(path)
    path.chmod(0o644)
    with pytest.raises(ConfigError) as refused:
        load_config(path)
    said = "outputs.mqtt.password: others may read or change it (mode 644); chmod 600"
    assert str(refused.value) == f"{path}: {said} {path}, or use password_file"
