"""A backup is put back whole, or refused with one line and nothing changed."""

import json
import os
import random
import sqlite3
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.health.store.events import EventLog
from edge_service.health.store.store import FILE_NAME, Store, held

from ..messages.examples import event_of

CONFIG = """
[bus]
zenoh_file = "zenoh.json5"
[store]
folder = "{folder}"
[[axes]]
name = "X"
machine = "machines/x.toml"
"""
FILES = {
    "axes/Y/axis.toml": b"[[axes]]\nname = 'Y'\nmachine = 'machine.toml'",
    "axes/Y/machine.toml": b"[axis]",
    "recordings/healthy_X_20261121T081530Z.parquet": b"PAR1" * 500,
    "jobs/1/report.html": b"<p>a report</p>",
    f"{FILE_NAME}.damaged-20261121T081530Z": b"half",
}
KEPT = {"axes/Y/axis.toml", "axes/Y/machine.toml", FILE_NAME}
MACHINE = (Path(__file__).parents[2] / "deploy" / "machine.toml").read_bytes()
State = dict[str, bytes]


def written(folder: Path, files: State) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def state(folder: Path) -> State:
    """All files below a folder, but what SQLite keeps beside a store."""
    found = (path for path in folder.rglob("*") if path.is_file())
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in found
        if not path.name.endswith(("-wal", "-shm"))
    }


def note(folder: Path, text: str) -> None:
    with closing(Store(folder / FILE_NAME)) as store:
        EventLog(store).add((event_of(text),), 1)


def notes(folder: Path) -> list[str]:
    with closing(Store(folder / FILE_NAME, mends=False)) as store:
        return [each.event.text for each in EventLog(store).after(0, 10)]


@pytest.fixture(params=["apart", "inside"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A configuration in `etc`, its state in `etc/var` or `var`, and `backup.zip` of both."""
    folder = "var" if request.param == "inside" else "../var"
    etc = {"edge.toml": CONFIG.format(folder=folder).encode(), "zenoh.json5": b"{}"}
    written(tmp_path / "etc", etc | {"machines/x.toml": MACHINE, "other.txt": b"not ours"})
    written(var_of(tmp_path / "etc", folder), FILES)
    note(var_of(tmp_path / "etc", folder), "before")
    assert main(["backup", str(tmp_path / "etc/edge.toml"), "--out", str(backup(tmp_path))]) == 0
    (tmp_path / "kind").write_text(folder)
    return tmp_path


def var_of(etc: Path, folder: str) -> Path:
    return Path(os.path.normpath(etc / folder))


def var(place: Path, root: str = ".") -> Path:
    return var_of(place / root / "etc", (place / "kind").read_text())


def backup(place: Path) -> Path:
    return place / "backup.zip"


def restored(place: Path, *more: str) -> int:
    """Exit status of a restore to `new/etc`."""
    return main(["restore", str(backup(place)), str(place / "new/etc/mill.toml"), *more])


@pytest.mark.parametrize("recordings", [False, True])
def test_what_was_there_is_there_again(place: Path, recordings: bool) -> None:
    line = ["backup", str(place / "etc/edge.toml"), "--out", str(backup(place))]
    assert main([*line, *(["--recordings"] if recordings else [])]) == 0
    assert restored(place) == 0
    assert notes(var(place, "new")) == ["before"]
    extra = {name for name in FILES if recordings and name.startswith("recordings")}
    assert set(state(var(place, "new"))) == KEPT | extra
    etc = state(place / "new/etc")
    assert etc["mill.toml"] == (place / "etc/edge.toml").read_bytes()
    assert {name for name in etc if not name.startswith("var")} == {
        *("mill.toml", "zenoh.json5", "machines/x.toml")
    }
    assert (var(place, "new") / FILE_NAME).stat().st_mode & 0o777 == 0o640


def test_secrets_stay_with_their_owner(place: Path) -> None:
    (place / "etc/zenoh.json5").chmod(0o600)
    assert main(["backup", str(place / "etc/edge.toml"), "--out", str(backup(place))]) == 0
    assert backup(place).stat().st_mode & 0o777 == 0o600
    assert restored(place) == 0
    assert (place / "new/etc/zenoh.json5").stat().st_mode & 0o777 == 0o600


def test_files_elsewhere_are_named(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (place / "machine.toml").write_bytes(MACHINE)
    config = place / "etc/edge.toml"
    config.write_text(config.read_text().replace("machines/x.toml", "../machine.toml"))
    capsys.readouterr()
    assert main(["backup", str(config), "--out", str(backup(place))]) == 0
    assert f"lies elsewhere: {place}/etc/../machine.toml" in capsys.readouterr().out


def rebuilt(place: Path, change: Callable[[dict[str, bytes], dict[str, object]], None]) -> None:
    """Write the backup again with other members or another manifest."""
    with zipfile.ZipFile(backup(place)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    manifest = json.loads(members.pop("manifest.json"))
    change(members, manifest)
    with zipfile.ZipFile(backup(place), "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
        archive.writestr("manifest.json", json.dumps(manifest))


def added(name: str) -> Callable[[dict[str, bytes], dict[str, object]], None]:
    def change(members: dict[str, bytes], manifest: dict[str, object]) -> None:
        files = manifest["files"]
        assert isinstance(files, dict)
        old = next(iter(members))
        members[name], files[name] = members[old], files[old]

    return change


def without(name: str) -> Callable[[dict[str, bytes], dict[str, object]], None]:
    return lambda members, _manifest: members.pop(name) and None


def described(**changes: object) -> Callable[[dict[str, bytes], dict[str, object]], None]:
    return lambda _members, manifest: manifest.update(changes)


def refused(place: Path, capsys: pytest.CaptureFixture[str], *more: str) -> str:
    """The one line of a restore that must change nothing."""
    before = state(place)
    capsys.readouterr()
    assert restored(place, *more) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    assert state(place) == before
    assert not [path for path in place.rglob("*") if "restore" in path.name]
    return line


HOSTILE = {
    "upwards": added("state/../../escaped"),
    "upwards at once": added("../escaped"),
    "absolute": added("/tmp/escaped"),
    "absolute within": added("state//tmp/escaped"),
    "elsewhere": added("etc/passwd"),
    "no folder": added("state"),
    "a folder": added("state/"),
    "a dot": added("config/./edge.toml"),
    "a line break": added("state/a\nb"),
    "a file as a folder": added("config/zenoh.json5/x"),
    "too long": added("state/" + "x" * 300),
    "less than described": without("state/axes/Y/axis.toml"),
    "newer format": described(format="backup/9"),
    "newer version": described(version="99.0.0"),
    "no version": described(version="one"),
    "no files": described(files={}),
    "no manifest": described(files=None),
}


@pytest.mark.parametrize("how", HOSTILE)
def test_a_hostile_archive_is_refused(
    how: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rebuilt(place, HOSTILE[how])
    line = refused(place, capsys)
    assert ("another version" in line or "99.0.0" in line) is how.startswith("newer")
    assert not Path("/tmp/escaped").exists()


def test_a_configuration_elsewhere_stays_where_it_is(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = place / "other.toml"
    other.write_text("# of somebody else\n")

    def change(members: dict[str, bytes], manifest: dict[str, object]) -> None:
        members.clear()
        members[f"config/{other}"] = b""
        manifest |= {"config": str(other), "files": {}}

    rebuilt(place, change)
    refused(place, capsys)


def test_a_link_comes_as_no_link(place: Path) -> None:
    rebuilt(place, added("state/link"))
    with zipfile.ZipFile(backup(place), "a") as archive:
        archive.getinfo("state/link").external_attr = 0o120777 << 16
        archive._didModify = True  # type: ignore[attr-defined]
    restored(place)
    assert not [path for path in place.rglob("*") if path.is_symlink()]


def test_a_bomb_is_refused(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with zipfile.ZipFile(backup(place), "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("state/bomb", bytes(10_000_000))
    assert "compressed" in refused(place, capsys)


@pytest.mark.parametrize("seed", range(20))
def test_damage_is_refused_or_harmless(
    seed: int, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A flipped byte or a cut anywhere: refused, or in a place that carries nothing."""
    rng = random.Random(seed)
    content = bytearray(backup(place).read_bytes())
    at = rng.randrange(len(content))
    if seed % 2:
        content[at] ^= 1 << rng.randrange(8)
    else:
        del content[at:]
    backup(place).write_bytes(content)
    before = state(place)
    status = restored(place)
    if status == 0:
        assert notes(var(place, "new")) == ["before"]
        return
    assert (status, len(capsys.readouterr().err.splitlines())) == (2, 1)
    assert state(place) == before


def test_nothing_that_is_there_is_overwritten_unless_it_is_wanted(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert restored(place) == 0
    note(var(place, "new"), "later")
    assert "is not empty" in refused(place, capsys)
    (place / "new/etc/zenoh.json5").write_bytes(b"mine")
    assert "zenoh.json5 is there already, and differs" in refused(place, capsys)
    (place / "new/etc/beside.txt").write_bytes(b"beside")
    assert "beside.txt is no part of the backup" in refused(place, capsys, "--force")
    (place / "new/etc/beside.txt").unlink()
    assert restored(place, "--force") == 0
    assert (place / "new/etc/zenoh.json5").read_bytes() == b"{}"
    assert notes(var(place, "new")) == ["before"]
    (before,) = (place / "new").glob("etc.before-*")
    assert (before / "zenoh.json5").read_bytes() == b"mine"
    aside = before / "var" if (before / "var").exists() else next((place / "new").glob("var.b*"))
    assert notes(aside) == ["before", "later"]


def test_a_store_that_a_service_uses_is_refused(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert restored(place) == 0
    with closing(sqlite3.connect(var(place, "new") / FILE_NAME)) as other:
        other.execute("PRAGMA journal_mode = WAL")
        other.execute("SELECT * FROM events").fetchall()
        assert "stop the service first" in refused(place, capsys, "--force")
    with held(var(place, "new")):  # by a service that has not opened it yet
        assert "another service runs on it" in refused(place, capsys, "--force")


@pytest.mark.parametrize("fails_at", [0, 1, 2, 3])
def test_a_folder_that_cannot_be_replaced_leaves_all_as_it_was(
    place: Path, fails_at: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert restored(place) == 0
    note(var(place, "new"), "later")
    (place / "new/etc/zenoh.json5").write_bytes(b"mine")
    rename, left = Path.replace, [fails_at]
    places = {place / "new/etc", var(place, "new")}

    def failing(path: Path, target: Path) -> Path:
        if path in places or target in places:
            left[0] -= 1
            if left[0] == -1:
                raise OSError(16, "Device or resource busy", str(path))
        return rename(path, target)

    monkeypatch.setattr(Path, "replace", failing)
    if restored(place, "--force") == 0:
        assert left[0] >= 0  # there are fewer renames than that
        return
    monkeypatch.undo()
    assert "busy" in capsys.readouterr().err
    assert notes(var(place, "new")) == ["before", "later"]
    assert (place / "new/etc/zenoh.json5").read_bytes() == b"mine"
    assert not [path for path in place.rglob("*") if "before-" in path.name]


def test_a_mount_point_is_one_line(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert restored(place) == 0
    mounted = {place / "new/etc", var(place, "new")}
    monkeypatch.setattr(Path, "is_mount", lambda path: path in mounted)
    assert "is a mount point" in refused(place, capsys, "--force")
