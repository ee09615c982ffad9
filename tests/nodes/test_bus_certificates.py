"""What may be wrong with the certificates of the bus: each is one line of check-config."""

import re
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from edge_service import certificates
from edge_service.bus.access import PUTS, client_name
from edge_service.certificates import make_certificates
from edge_service.cli.entry import main
from edge_service.config import BusConfig, ConfigError
from edge_service.nodes.wiring.bus_certificates import NAMES, check_bus

CLIENTS = {role: client_name(role) for role in PUTS}


def made(folder: Path, days: int = 30) -> BusConfig:
    make_certificates(folder, (), CLIENTS, days)
    return BusConfig(certificates=folder)


def _swap(folder: Path, first: str, second: str) -> None:
    (folder / second).write_bytes((folder / first).read_bytes())


def _foreign(folder: Path, name: str) -> None:
    made(folder / "other")
    for kind in ("pem", "key"):
        _swap(folder / "other", f"{name}.{kind}", f"../{name}.{kind}")


MISTAKES: dict[str, tuple[Callable[[Path], object], str]] = {
    "no authority": (lambda f: (f / "ca.pem").unlink(), "ca.pem: cannot be read (No such file"),
    "no pair at all": (
        lambda f: [each.unlink() for each in f.iterdir() if each.name != "ca.pem"],
        "at least one of server, reader, acquire",
    ),
    "a key without its certificate": (
        lambda f: (f / "http.pem").unlink(),
        "http.pem: cannot be read (No such file",
    ),
    "a certificate without its key": (
        lambda f: (f / "http.key").unlink(),
        "http.key: No such file",
    ),
    "a folder": (
        lambda f: ((f / "http.pem").unlink(), (f / "http.pem").mkdir()),
        "http.pem: cannot be read (Is a directory)",
    ),
    "no certificate": (lambda f: (f / "http.pem").write_text("x"), "http.pem: contains no cert"),
    "no key": (lambda f: (f / "http.key").write_text("x"), "http.key: contains no key"),
    "a key for everybody": (lambda f: (f / "http.key").chmod(0o644), "http.key: others may read"),
    "a key of another": (lambda f: _swap(f, "health.key", "http.key"), "http.key does not belong"),
    "of another authority": (lambda f: _foreign(f, "http"), "http.pem: was not signed by ca.pem"),
    "another authority": (
        lambda f: (made(f / "other"), _swap(f / "other", "ca.pem", "../ca.pem")),
        "server.pem: was not signed by ca.pem",
    ),
    "of another role": (
        lambda f: [_swap(f, f"health.{kind}", f"http.{kind}") for kind in ("pem", "key")],
        "http.pem: does not have the common name http.node.edge-service",
    ),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_with_its_file(mistake: str, tmp_path: Path) -> None:
    bus = made(tmp_path)
    spoil, words = MISTAKES[mistake]
    spoil(tmp_path)
    with pytest.raises(ConfigError, match=r"^bus\.certificates: ") as caught:
        check_bus(bus)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", NAMES)
def test_every_pair_that_is_there_is_looked_at(name: str, tmp_path: Path) -> None:
    bus = made(tmp_path)
    (tmp_path / f"{name}.pem").write_text("x")
    with pytest.raises(ConfigError, match=rf"/{name}\.pem: contains no certificate"):
        check_bus(bus)


@pytest.mark.parametrize(("ago", "words"), [(60, "expired on"), (-60, "is not valid before")])
def test_a_pair_that_does_not_hold_now_is_named(
    ago: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Then(datetime):
        @classmethod
        def now(cls, tz: object = None) -> datetime:  # type: ignore[override]
            return datetime.now(UTC) - timedelta(days=ago)

    with monkeypatch.context() as patch:
        patch.setattr(certificates, "datetime", Then)
        bus = made(tmp_path)
    with pytest.raises(ConfigError, match=re.escape(words)):
        check_bus(bus)


def test_a_machine_with_one_role_needs_no_other(tmp_path: Path) -> None:
    bus = made(tmp_path)
    for path in tmp_path.iterdir():
        if path.stem not in ("ca", "acquire"):
            path.unlink()
    until = datetime.now(UTC) + timedelta(days=30)
    assert check_bus(bus) == f"bus: readers, certificates of acquire until {until:%Y-%m-%d}"
    assert check_bus(BusConfig()) == "bus: readers"


def test_check_config_ends_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made(tmp_path / "certificates")
    config = tmp_path / "edge.toml"
    config.write_text('[bus]\ncertificates = "certificates"\n[[axes]]\nname = "X"\n')
    assert main(["check-config", str(config)]) == 0
    assert "certificates of server, reader, acquire" in capsys.readouterr().out
    (tmp_path / "certificates" / "server.key").unlink()
    assert main(["check-config", str(config)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "server.key: No such file" in error
