"""A backup is put back whole, or refused with one line and nothing changed."""

import errno
import json
import random
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from edge_service.cli.entry import main
from edge_service.config import ConfigError, load_config
from edge_service.nodes.stores.history_store import open_history

CONFIG = """
[history]
folder = "{history}"
[[axes]]
name = "X"
machine = "machines/x.toml"
"""
FILES = {
    "axis=X/watch.json": b'{"sha256": "0", "content": 1}\n',
    "axis=X/raw/2026-01-01T00.parquet": b"PAR1" * 500,
    "@jobs/1/report.html": b"<p>a report</p>",
    "@recordings/X/healthy.csv": b"time_s,torque_nm\n",
    "@bus/acquire.key": b"secret",
    "@diary.copy.sqlite": b"copy",
    "axis=X/.watch.json.0.part": b"half",
}
LEFT_OUT = {"@bus/acquire.key", "@diary.copy.sqlite", "axis=X/.watch.json.0.part"}
MACHINE = (Path(__file__).parents[2] / "deploy" / "machine.toml").read_bytes()
State = dict[str, bytes]


def written(folder: Path, files: State) -> None:
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)


def state(folder: Path) -> State:
    """All files below a folder but the lock."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != "@lock")
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A configuration in `etc`, a history in `var`, and `backup.zip` of both."""
    etc = {"edge.toml": CONFIG.format(history=tmp_path / "var").encode(), "tokens.json": b"{}"}
    written(tmp_path / "etc", etc | {"machines/x.toml": MACHINE, "other.txt": b"not ours"})
    written(tmp_path / "var", FILES)
    assert main(["backup", str(tmp_path / "etc/edge.toml"), "--out", str(backup(tmp_path))]) == 0
    return tmp_path


def backup(place: Path) -> Path:
    return place / "backup.zip"


def restored(place: Path, *more: str) -> int:
    """Exit status of a restore to `new/etc` and `new/var`."""
    new = place / "new"
    line = ["restore", str(backup(place)), "--config", str(new / "etc/mill.toml")]
    return main([*line, "--history", str(new / "var"), *more])


@pytest.mark.parametrize("recordings", [False, True])
def test_what_was_there_is_there_again(place: Path, recordings: bool) -> None:
    line = ["backup", str(place / "etc/edge.toml"), "--out", str(backup(place))]
    assert main([*line, *(["--recordings"] if recordings else [])]) == 0
    assert restored(place) == 0
    left_out = LEFT_OUT if recordings else LEFT_OUT | {"@recordings/X/healthy.csv"}
    assert state(place / "new/var") == {n: c for n, c in FILES.items() if n not in left_out}
    etc = state(place / "new/etc")
    assert etc.pop("mill.toml") == (place / "etc/edge.toml").read_bytes()
    assert etc == {"tokens.json": b"{}", "machines/x.toml": MACHINE}


def test_secrets_stay_with_their_owner(place: Path) -> None:
    (place / "etc/tokens.json").chmod(0o600)
    assert main(["backup", str(place / "etc/edge.toml"), "--out", str(backup(place))]) == 0
    assert backup(place).stat().st_mode & 0o777 == 0o600
    assert restored(place) == 0
    assert (place / "new/etc/tokens.json").stat().st_mode & 0o777 == 0o600


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
    """A sound member under a name of its own."""

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
    "upwards": added("history/../../escaped"),
    "upwards at once": added("../escaped"),
    "absolute": added("/tmp/escaped"),
    "absolute within": added("history//tmp/escaped"),
    "elsewhere": added("etc/passwd"),
    "no folder": added("history"),
    "a folder": added("history/"),
    "a dot": added("config/./edge.toml"),
    "the lock": added("history/@lock"),
    "the mark of a restore": added("history/@restore/x"),
    "a line break": added("history/a\nb"),
    "a file as a folder": added("config/tokens.json/x"),
    "too long": added("history/" + "x" * 300),
    "less than described": without("history/axis=X/watch.json"),
    "newer format": described(format="backup/2"),
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
    assert ("newer version" in line or "99.0.0" in line) is how.startswith("newer")
    assert not Path("/tmp/escaped").exists()


def test_a_link_comes_as_no_link(place: Path) -> None:
    rebuilt(place, added("history/link"))
    with zipfile.ZipFile(backup(place), "a") as archive:
        archive.getinfo("history/link").external_attr = 0o120777 << 16
        archive._didModify = True  # type: ignore[attr-defined]
    restored(place)
    assert not [path for path in place.rglob("*") if path.is_symlink()]


def test_a_bomb_is_refused(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with zipfile.ZipFile(backup(place), "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("history/bomb", bytes(10_000_000))
    assert "compressed" in refused(place, capsys)


def test_what_does_not_fit_the_disk_is_refused(
    place: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    full = type("Usage", (), {"free": 1000})
    monkeypatch.setattr("shutil.disk_usage", lambda _path: full)
    assert "not free" in refused(place, capsys)


@pytest.mark.parametrize("seed", range(40))
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
        wanted = {n: c for n, c in FILES.items() if n not in LEFT_OUT and "@rec" not in n}
        assert state(place / "new/var") == wanted
        return
    assert status == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert state(place) == before


def test_nothing_that_is_there_is_overwritten(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert restored(place) == 0
    assert "is not empty" in refused(place, capsys, "--force")
    (place / "new/etc/tokens.json").write_bytes(b"mine")
    line = ["restore", str(backup(place)), "--config", str(place / "new/etc/mill.toml")]
    assert main(line) == 2
    assert (place / "new/etc/tokens.json").read_bytes() == b"mine"
    assert main([*line, "--force"]) == 0
    assert (place / "new/etc/tokens.json").read_bytes() == b"{}"


def test_a_restore_that_was_cut_off_starts_no_service(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A power failure between two files leaves a mark, so that half a history is taken for none."""
    left, replace = ["once"], Path.replace

    def failing(path: Path, target: Path) -> Path:
        if not left:
            raise OSError(errno.EIO, "Input/output error", str(path))
        left.pop()
        return replace(path, target)

    monkeypatch.setattr(Path, "replace", failing)
    assert main(["restore", str(backup(place)), "--history", str(place / "new/var")]) == 2
    monkeypatch.undo()
    config = load_config(place / "etc/edge.toml")
    kept = config.history.model_copy(update={"folder": place / "new/var"})
    with pytest.raises(ConfigError, match="was interrupted"):
        open_history(config.model_copy(update={"history": kept}), {})
