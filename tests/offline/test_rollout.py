"""A bundle is put in place whole and by its signer alone, or refused in one line unchanged."""

import errno
import hashlib
import json
import os
import shutil
import stat
import subprocess
import sys
import zipfile
from collections import namedtuple
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from edge_service import __version__
from edge_service.cli.entry import main
from edge_service.config import load_config
from edge_service.health.events.audit import read_audit
from edge_service.health.events.diary import Diary
from edge_service.nodes.stores.diary_store import DIARY
from edge_service.nodes.wiring.start_entry import start_entry
from edge_service.offline.rollout import keys, place
from edge_service.offline.rollout.changes import change_lines, changes
from edge_service.offline.rollout.contents import minor, signed_text
from edge_service.offline.rollout.toml_text import flat

MACHINE = (Path(__file__).parents[2] / "deploy" / "machine.toml").read_text()
CONFIG = """
[service]
site = "hall"
machine = "mill-1"
[http]
port = {port}
tokens_file = "tokens.json"
[history]
folder = "../history"
[email]
host = "mail.example.org"
user = "edge"
password_file = "mail.password"
sender = "edge@example.org"
recipients = ["maintenance@example.org"]
[[axes]]
name = "X"
machine = "machines/x.toml"
"""
MINOR = minor(__version__)
TIME = "2026-01-31T12:00:00+00:00"
NEW = {"edge.toml", "machines/x.toml", "fleet.toml"}
LOCAL = ("tokens.json", "mail.password", "machines/notes.txt")
State = dict[str, bytes]
Change = Callable[[dict[str, bytes]], None]


@pytest.fixture(scope="module")
def office(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Configurations of two machines, keys, and `7.bundle` of them."""
    folder = tmp_path_factory.mktemp("office")
    for machine in ("mill-1", "mill-2"):
        (folder / machine / "machines").mkdir(parents=True)
        text = CONFIG.format(port=9090).replace("mill-1", machine)
        (folder / machine / "edge.toml").write_text(text)
        changed = MACHINE.replace("1.5e-3", "{ value = 1.7e-3, tolerance = 0.02 }")
        (folder / machine / "machines/x.toml").write_text(changed)
        (folder / machine / "fleet.toml").write_text(
            '[[services]]\naddress = "http://127.0.0.1:8080"\n'
        )
    assert main(["rollout", "key", str(folder / "site.key")]) == 0
    assert main(["rollout", "key", str(folder / "other.key")]) == 0
    assert packed(folder, "7.bundle", "--number", "7") == 0
    return folder


def packed(office: Path, out: str, *more: str, machine: str = "") -> int:
    configs = [office / (machine or name) / "edge.toml" for name in ("mill-1", "mill-2")]
    given = [str(path) for path in dict.fromkeys(configs)]
    line = ["--key", str(office / "site.key"), "--out", str(office / out), "--time", TIME]
    return main(["rollout", "pack", *given, *line, "--fleet", "fleet.toml", *more])


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    """The folder of mill-1's configuration, with what no bundle governs."""
    folder = tmp_path / "etc"
    (folder / "machines").mkdir(parents=True)
    (tmp_path / "history").mkdir()
    (folder / "edge.toml").write_text(CONFIG.format(port=8080))
    (folder / "machines/x.toml").write_text(MACHINE)
    (folder / "machines/notes.txt").write_text("ours")
    (folder / "tokens.json").write_text('{"schema": "tokens/1", "tokens": []}')
    (folder / "mail.password").write_text("hush")
    (folder / "mail.password").chmod(0o600)
    line = ["token", "add", "kim", "--role", "admin", "--file", str(folder / "kim.json")]
    assert main(line) == 0
    (folder / "kim.json").replace(folder / "tokens.json")
    return folder


def applied(office: Path, machine: Path, *more: str, bundle: str = "7.bundle") -> int:
    line = ["rollout", "apply", str(office / bundle), "--trust", str(office / "site.pem")]
    return main([*line, "--machine", "mill-1", str(machine / "edge.toml"), *more])


def state(folder: Path) -> State:
    """What a reader finds under names that mean something, beside the folder of the roll-outs."""
    found = {}
    for path in folder.rglob("*"):
        name = path.relative_to(folder)
        if path.is_file() and not name.parts[0].endswith(".rollout") and path.suffix != ".part":
            found[name.as_posix()] = path.read_bytes()
    return found


def everything(folder: Path) -> State:
    """All files and links as they are."""
    return {
        path.relative_to(folder).as_posix(): str(path.readlink()).encode()
        if path.is_symlink()
        else path.read_bytes()
        for path in folder.rglob("*")
        if path.is_symlink() or path.is_file()
    }


def after(office: Path, before: State) -> State:
    """The state that bundle 7 leads to."""
    return before | {name: (office / "mill-1" / name).read_bytes() for name in NEW}


def test_a_bundle_takes_the_place_of_what_was_there(office: Path, machine: Path) -> None:
    before = state(machine)
    assert applied(office, machine) == 0
    assert state(machine) == after(office, before)
    assert load_config(machine / "edge.toml").http.port == 9090
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert state(machine) == before


def test_a_dry_run_tells_each_change_and_writes_nothing(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = everything(machine)
    capsys.readouterr()
    assert applied(office, machine, "--dry-run") == 0
    lines = capsys.readouterr().out.splitlines()
    assert everything(machine) == before
    assert "  http.port: 8080 -> 9090" in lines
    assert "  model.inertia_kg_m2: 0.0015 kg m2 -> 0.0017 kg m2 +- 2 %" in lines
    assert "fleet.toml: added" in lines
    assert "restart the service for edge.toml, machines/x.toml" in lines
    assert lines[-1] == "nothing was written"


def test_secrets_that_stood_here_are_not_shown(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = machine / "edge.toml"
    config.write_text(
        config.read_text() + '[webhook]\nurl = "http://h/s3"\nsecret = "s3-16-signs-long"\n'
    )
    config.chmod(0o600)
    capsys.readouterr()
    assert applied(office, machine, "--dry-run") == 0
    told = capsys.readouterr().out
    assert "  webhook.secret: (hidden) -> (none)" in told
    assert "s3" not in told


def test_the_service_knows_what_it_runs(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = machine / "edge.toml"
    assert load_config(config).identity.bundle is None
    assert applied(office, machine) == 0
    identity = load_config(config).identity
    capsys.readouterr()
    line = ["rollout", "show", str(office / "7.bundle"), "--trust", str(office / "site.pem")]
    assert main([*line, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert identity.bundle == 7
    assert identity.digest == shown["machines"][0]["configuration"]
    assert main(["rollout", "status", str(config), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["bundle"], told["highest"], told["changed_here"]) == (7, 7, [])
    (machine / "machines/x.toml").write_text(MACHINE)
    assert main(["rollout", "status", str(config), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["bundle"], told["rolled_out"]) == (None, 7)
    assert told["changed_here"] == ["machines/x.toml"]


def test_equal_input_gives_equal_bytes(office: Path) -> None:
    assert packed(office, "again.bundle", "--number", "7") == 0
    assert (office / "again.bundle").read_bytes() == (office / "7.bundle").read_bytes()


def test_the_next_bundle_has_the_next_number(
    office: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(office, tmp_path / "office")
    capsys.readouterr()
    assert packed(tmp_path / "office", "7.bundle") == 0
    assert "bundle 8 of site hall" in capsys.readouterr().out


def test_files_keep_mode_and_owner(office: Path, machine: Path) -> None:
    (machine / "edge.toml").chmod(0o640)
    if os.geteuid() == 0:
        os.chown(machine / "edge.toml", 12345, 12346)
    assert applied(office, machine) == 0
    for name in NEW:
        found = (machine / name).stat()
        assert stat.S_IMODE(found.st_mode) == 0o640
        if os.geteuid() == 0:
            assert (found.st_uid, found.st_gid) == (12345, 12346)


def test_a_new_machine_is_set_up(office: Path, machine: Path) -> None:
    (machine / "edge.toml").unlink()
    (machine / "machines/x.toml").unlink()
    before = state(machine)
    assert applied(office, machine) == 0
    assert state(machine) == after(office, before)
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 2


def test_files_that_a_bundle_no_longer_holds_go_and_come_back(
    office: Path, machine: Path, tmp_path: Path
) -> None:
    assert applied(office, machine) == 0
    with_fleet = state(machine)
    shutil.copytree(office, tmp_path / "office")
    (tmp_path / "office/mill-1/fleet.toml").unlink()
    assert packed(tmp_path / "office", "8.bundle", "--number", "8") == 0
    assert applied(tmp_path / "office", machine, bundle="8.bundle") == 0
    assert set(state(machine)) == set(with_fleet) - {"fleet.toml"}
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert state(machine) == with_fleet
    assert load_config(machine / "edge.toml").identity.bundle == 7


def test_what_was_changed_here_is_told_and_kept(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert applied(office, machine) == 0
    (machine / "edge.toml").unlink()
    (machine / "edge.toml").write_text(CONFIG.format(port=7070))
    changed = state(machine)
    assert packed(office, "9.bundle", "--number", "9") == 0
    capsys.readouterr()
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 2
    assert "edge.toml: changed here since; --force" in capsys.readouterr().err
    assert applied(office, machine, bundle="9.bundle") == 0
    assert "edge.toml: was changed here since bundle 7" in capsys.readouterr().out
    assert load_config(machine / "edge.toml").http.port == 9090
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert state(machine) == changed
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert load_config(machine / "edge.toml").identity.bundle == 7


def test_a_bundle_that_was_taken_back_does_not_return(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert applied(office, machine) == 0
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    capsys.readouterr()
    assert applied(office, machine) == 2
    assert "bundle 7 is not newer than bundle 7" in capsys.readouterr().err


def refused(office: Path, machine: Path, capsys: pytest.CaptureFixture[str], bundle: str) -> str:
    """The one line of a roll-out that must change nothing."""
    before = everything(machine)
    capsys.readouterr()
    assert applied(office, machine, bundle=bundle) == 2
    said = capsys.readouterr()
    (line,) = said.err.splitlines()
    assert said.out == ""
    assert everything(machine) == before
    return line


def rebuilt(office: Path, out: Path, change: Change, *, sign: bool, kind: int = 0) -> None:
    """Write the bundle again with other members; its signature is made anew only with `sign`."""
    with zipfile.ZipFile(office / "7.bundle") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    change(members)
    if sign:
        key = keys.signing_key(office / "site.key")
        members["signature"] = key.sign(signed_text(members["manifest.json"]))
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.external_attr = (kind if name.endswith("x.toml") else 0) << 16
            archive.writestr(info, content)


def stating(**changes: object) -> Change:
    def change(members: dict[str, bytes]) -> None:
        described = json.loads(members["manifest.json"])
        members["manifest.json"] = json.dumps(described | changes).encode()

    return change


def holding(name: str, content: bytes = b"") -> Change:
    """A file of mill-1 under a name of its own, described as it is."""

    def change(members: dict[str, bytes]) -> None:
        described = json.loads(members["manifest.json"])
        digest = hashlib.sha256(content).hexdigest()
        file = {"length": len(content), "sha256": digest}
        described["machines"]["mill-1"]["files"][name] = file
        members["manifest.json"] = json.dumps(described).encode()
        members[f"machines/mill-1/{name}"] = content

    return change


def without(name: str) -> Change:
    return lambda members: members.pop(name) and None


def with_content(name: str, content: bytes) -> Change:
    return lambda members: members.update({name: content})


UNSIGNED = {
    "another number": stating(number=8),
    "no signature": without("signature"),
    "an empty signature": with_content("signature", b""),
    "a long signature": with_content("signature", b"0" * 10_000),
    "no manifest": without("manifest.json"),
}
SIGNED = {
    "another format": stating(format="rollout/2"),
    "an unknown member": stating(more=1),
    "no machines": stating(machines={}),
    "another site": stating(site="yard"),
    "no version": stating(versions=[]),
    "another version": stating(versions=["0.9"]),
    "an old number": stating(number=0),
    "no JSON": with_content("manifest.json", b"{"),
    "deep JSON": with_content("manifest.json", b"[" * 100_000),
    "a missing file": without("machines/mill-1/edge.toml"),
    "another content": with_content("machines/mill-1/edge.toml", b"[service]\n"),
    "a file beside": with_content("machines/mill-1/more.toml", b""),
    "upwards": holding("../edge.toml"),
    "upwards within": holding("machines/../../edge.toml"),
    "absolute": holding("/etc/edge.toml"),
    "its own folder": holding(".edge.toml.rollout/highest"),
    "no name": holding(""),
    "a backslash": holding("..\\edge.toml"),
    "a control character": holding("a\nb.toml"),
    "a refused configuration": holding("edge.toml", b'[http]\nport = "x"\n[[axes]]\nname = "X"\n'),
    "an unknown key": holding("edge.toml", b"[htp]\n"),
    "no TOML": holding("edge.toml", b"\xff"),
    "a refused machine file": holding("machines/x.toml", b"[axis]\n"),
}


@pytest.mark.parametrize("name", UNSIGNED)
def test_what_nobody_signed_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    rebuilt(office, machine.parent / "bad.bundle", UNSIGNED[name], sign=False)
    refused(office, machine, capsys, str(machine.parent / "bad.bundle"))


@pytest.mark.parametrize("name", SIGNED)
def test_what_makes_no_sense_is_refused_although_it_is_signed(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    rebuilt(office, machine.parent / "bad.bundle", SIGNED[name], sign="signature" not in name)
    refused(office, machine, capsys, str(machine.parent / "bad.bundle"))


@pytest.mark.parametrize("kind", [stat.S_IFLNK | 0o777, stat.S_IFDIR | 0o755, stat.S_IFIFO])
def test_links_and_folders_are_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], kind: int
) -> None:
    rebuilt(office, machine.parent / "bad.bundle", stating(), sign=True, kind=kind)
    line = refused(office, machine, capsys, str(machine.parent / "bad.bundle"))
    assert "no plain file" in line


def test_a_compressed_bomb_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bomb = machine.parent / "bomb.bundle"
    with zipfile.ZipFile(bomb, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("manifest.json", "signature"):
            archive.writestr(name, b"0" * (0 if name == "signature" else 3_000_000))
    assert "compressed" in refused(office, machine, capsys, str(bomb))


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_cut_off_bundle_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], share: float
) -> None:
    whole = (office / "7.bundle").read_bytes()
    (machine.parent / "cut.bundle").write_bytes(whole[: int(share * len(whole))])
    refused(office, machine, capsys, str(machine.parent / "cut.bundle"))


def test_every_flipped_bit_is_harmless(office: Path, machine: Path) -> None:
    """A bit that the archive does not need may differ; what is read is what was signed."""
    whole = bytearray((office / "7.bundle").read_bytes())
    before, path = everything(machine), machine.parent / "flipped.bundle"
    for at in range(0, len(whole), 97):
        whole[at] ^= 1 << at % 8
        path.write_bytes(whole)
        whole[at] ^= 1 << at % 8
        assert main(["rollout", "show", str(path), "--trust", str(office / "site.pem")]) in (0, 2)
    assert everything(machine) == before


def test_a_bundle_by_another_signer_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(office / "7.bundle", machine.parent / "7.bundle")
    shutil.copy(office / "other.pem", machine.parent / "site.pem")
    assert "is not signed by" in refused(machine.parent, machine, capsys, "7.bundle")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ('machine = "mill-1"', "is for mill-1, mill-2 of site hall, not for 'mill-9'"),
        ('site = "hall"', "this is mill-1 of site yard"),
    ],
)
def test_a_bundle_for_others_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], change: str, words: str
) -> None:
    if "machine" in change:
        capsys.readouterr()
        line = ["rollout", "apply", str(office / "7.bundle"), "--trust", str(office / "site.pem")]
        assert main([*line, "--machine", "mill-9", str(machine / "edge.toml")]) == 2
        assert words in capsys.readouterr().err
        return
    config = machine / "edge.toml"
    config.write_text(config.read_text().replace(change, 'site = "yard"'))
    assert words in refused(office, machine, capsys, "7.bundle")


def test_another_machines_part_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["rollout", "apply", str(office / "7.bundle"), "--trust", str(office / "site.pem")]
    assert main([*line, "--machine", "mill-2", str(machine / "edge.toml")]) == 2
    assert "the bundle is for mill-2 of site hall" in capsys.readouterr().err


def test_a_link_to_elsewhere_is_not_replaced(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (machine / "machines/x.toml").replace(machine.parent / "x.toml")
    (machine / "machines/x.toml").symlink_to(machine.parent / "x.toml")
    assert "is a link to elsewhere" in refused(office, machine, capsys, "7.bundle")


def test_a_full_disk_changes_nothing(
    office: Path, machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever cannot be written, a reader finds the old state."""
    before = state(machine)
    free = namedtuple("free", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: free(1, 1, 0))
    assert applied(office, machine) == 2
    monkeypatch.undo()
    for failing in ("replaced_bytes", "replaced_file", "_relink"):

        def fail(path: Path, *_more: object) -> None:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))

        monkeypatch.setattr(place, failing, fail)
        assert applied(office, machine) == 2
        monkeypatch.undo()
        assert state(machine) == before
        assert not list(machine.rglob("*.part"))
    assert applied(office, machine) == 0
    assert state(machine) == after(office, before)


def killed(folder: Path, out: Path, *command: str) -> list[Path]:
    """Copies of a folder in which a command was killed at its first, second, ... step."""
    script = Path(__file__).with_name("rollout_killed.py")
    line = [sys.executable, str(script), str(folder), str(out), *command]
    done = subprocess.run(line, check=True, capture_output=True, text=True, timeout=300)
    steps = int(done.stdout)
    assert steps > 5
    return [out / str(step) for step in range(1, steps + 2)]


@pytest.mark.slow
@pytest.mark.parametrize("first", [True, False])
def test_whoever_is_killed_leaves_the_old_state_or_the_new(
    office: Path, machine: Path, first: bool
) -> None:
    """At any step, and the next one goes through."""
    if not first:
        assert packed(office, "6.bundle", "--number", "6") == 0
        assert applied(office, machine, bundle="6.bundle") == 0
        (machine / "machines/x.toml").unlink()
        (machine / "machines/x.toml").write_text(MACHINE + "# changed here\n")
    before, out = state(machine), machine.parent / "killed"
    (out / "history").mkdir(parents=True)
    line = ["rollout", "apply", str(office / "7.bundle"), "--trust", str(office / "site.pem")]
    copies = killed(machine, out, *line, "--machine", "mill-1", "{place}/edge.toml")
    found = [state(copy) for copy in copies]
    expected = after(office, before)
    assert [each for each in found if each not in (before, expected)] == []
    assert found[0] == before
    assert found[-1] == expected
    assert packed(office, "8.bundle", "--number", "8") == 0
    for copy in copies:
        assert applied(office, copy, bundle="8.bundle") == 0
        assert state(copy) == expected
        left = [path.name for path in copy.rglob("*.part")]
        assert left == [], copy


@pytest.mark.slow
def test_whoever_is_killed_while_going_back_leaves_the_old_state_or_the_new(
    office: Path, machine: Path
) -> None:
    before = state(machine)
    assert applied(office, machine) == 0
    now, out = state(machine), machine.parent / "killed"
    (out / "history").mkdir(parents=True)
    copies = killed(machine, out, "rollout", "back", "{place}/edge.toml")
    found = [state(copy) for copy in copies]
    assert [each for each in found if each not in (before, now)] == []
    assert found[-1] == before


SECRETS = {
    "a password": ("password_file = ", "password = "),
    "an address with a password": ('host = "mail.example.org"', 'host = "http://a:b@mail"'),
    "a webhook": ("[[axes]]", '[webhook]\nurl = "http://127.0.0.1/T0K3N"\n[[axes]]'),
    "a driver's password": (
        'machine = "machines/x.toml"',
        'machine = "machines/x.toml"\ndriver = "mqtt"\nsettings = { password = "hush" }',
    ),
    "a private key": ("[http]", "# -----BEGIN PRIVATE KEY-----\n[http]"),
}


@pytest.mark.parametrize("name", SECRETS)
def test_secrets_are_not_packed(
    office: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    shutil.copytree(office, tmp_path / "office")
    config = tmp_path / "office/mill-1/edge.toml"
    config.write_text(config.read_text().replace(*SECRETS[name]))
    capsys.readouterr()
    assert packed(tmp_path / "office", "secret.bundle") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "hush" not in line
    assert "T0K3N" not in line
    assert not (tmp_path / "office/secret.bundle").exists()


def test_secrets_that_lie_in_files_stay(office: Path, machine: Path) -> None:
    content = (office / "7.bundle").read_bytes()
    assert b"hush" not in content
    with zipfile.ZipFile(office / "7.bundle") as archive:
        names = [name for name in archive.namelist() if name.startswith("machines/mill-1/")]
    assert names == [f"machines/mill-1/{name}" for name in sorted(NEW)]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("machines/x.toml", "../mill-2/machines/x.toml"), "does not lie beside"),
        (("machines/x.toml", "machines/y.toml"), "no such file"),
        (('"mill-1"', '"mill-2"'), "another one's name too"),
        (('"mill-1"', '".."'), "no name of a machine"),
        (('"hall"', '"yard"'), "a bundle is for one site"),
        (("9090", '"x"'), "http.port"),
    ],
)
def test_what_makes_no_sense_is_not_packed(
    office: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: tuple[str, str],
    words: str,
) -> None:
    shutil.copytree(office, tmp_path / "office")
    config = tmp_path / "office/mill-1/edge.toml"
    config.write_text(config.read_text().replace(*change))
    capsys.readouterr()
    assert packed(tmp_path / "office", "8.bundle") == 2
    assert words in capsys.readouterr().err


def test_the_private_key_is_its_owners_alone(
    office: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert stat.S_IMODE((office / "site.key").stat().st_mode) == 0o600
    assert main(["rollout", "key", str(office / "site.key")]) == 2
    shutil.copytree(office, tmp_path / "office")
    (tmp_path / "office/site.key").chmod(0o644)
    capsys.readouterr()
    assert packed(tmp_path / "office", "8.bundle") == 2
    assert "others may read" in capsys.readouterr().err


@pytest.mark.parametrize(
    "content", ["", "x", "-----BEGIN PUBLIC KEY-----\nAA==\n-----END PUBLIC KEY-----\n"]
)
def test_what_is_no_key_is_refused(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    trust = machine.parent / "site.pem"
    trust.write_text(content)
    shutil.copy(office / "7.bundle", machine.parent)
    assert str(trust) in refused(machine.parent, machine, capsys, "7.bundle")


def started(machine: Path) -> None:
    """Note a start in the audit log, as the service does."""
    with closing(Diary(machine.parent / "history" / DIARY)) as diary:
        diary.add((), 1, (start_entry(load_config(machine / "edge.toml"), ("http",)),))


def told_of(machine: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    capsys.readouterr()
    assert main(["rollout", "status", str(machine / "edge.toml"), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def test_the_status_tells_what_the_service_was_started_with(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert told_of(machine, capsys)["started"] is None
    started(machine)
    assert told_of(machine, capsys)["needs_restart"] is False
    assert applied(office, machine) == 0
    told = told_of(machine, capsys)
    assert told["needs_restart"] is True
    assert told["started"]["bundle"] is None
    started(machine)
    told = told_of(machine, capsys)
    assert told["needs_restart"] is False
    assert told["started"]["bundle"] == 7
    assert told["started"]["configuration"] == told["configuration"]


def test_roll_outs_stand_in_the_audit_log(office: Path, machine: Path) -> None:
    started(machine)
    assert applied(office, machine) == 0
    assert applied(office, machine) == 2
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    records = read_audit(machine.parent / "history" / DIARY)
    told = [(each.entry.action, each.entry.outcome) for each in records[1:] if each.entry]
    assert [action for action, _ in told] == 4 * ["apply_rollout"] + 2 * ["take_back_rollout"]
    assert [outcome.partition(":")[0] for _, outcome in told] == [
        *("begun", "done"),
        *("begun", "refused"),
        *("begun", "done"),
    ]


def test_what_was_read_stays_what_it_was(office: Path, machine: Path) -> None:
    """A part of the service that starts anew after a roll-out finds the files of its service."""
    assert applied(office, machine) == 0
    old = load_config(machine / "edge.toml")
    content = old.axes[0].machine.read_bytes()
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert old.axes[0].machine.read_bytes() == content
    assert load_config(machine / "edge.toml").axes[0].machine.read_bytes() != content


def test_a_machine_file_that_was_edited_here_is_read(office: Path, machine: Path) -> None:
    assert applied(office, machine) == 0
    (machine / "machines/x.toml").unlink()
    (machine / "machines/x.toml").write_text(MACHINE)
    assert load_config(machine / "edge.toml").axes[0].machine == machine / "machines/x.toml"


def test_a_refusal_leaves_no_folder(office: Path, machine: Path) -> None:
    config = machine / "edge.toml"
    config.write_text(config.read_text().replace("hall", "yard"))
    assert applied(office, machine) == 2
    assert not (machine / "edge.toml.rollout").exists()


def test_entries_of_one_name_are_numbered() -> None:
    text = b"[[e]]\nname = 'a'\n[[e]]\nname = 'a'\nx = 1\n[[f]]\nname = 'b'\ny = 2\n"
    assert flat(text, "m.toml") == {"e.1.name": "a", "e.2.name": "a", "e.2.x": 1} | {
        "f.b.name": "b",
        "f.b.y": 2,
    }


def test_long_lists_are_counted_and_units_are_sure() -> None:
    old = b"[c]\nmap_m = [1, 2, 3, 4, 5, 6, 7, 8, 9]\nslope_s2_per_m = 1.0\nspeed_rad_s = 1\n"
    new = old.replace(b"9]", b"0]").replace(b"= 1", b"= 2").replace(b"_s = 2", b"_s = 3")
    (file,) = changes({"m.toml": old}, {"m.toml": new})
    assert [(each.key, each.old, each.new) for each in file.keys] == [
        ("c.map_m", "9 entries", "9 entries, 1 differ"),
        ("c.slope_s2_per_m", "1.0", "2.0"),
        ("c.speed_rad_s", "1 rad/s", "3 rad/s"),
    ]


def test_a_change_of_comments_needs_no_restart() -> None:
    (file,) = changes({"e.toml": b"a = 1\n"}, {"e.toml": b"# one\na = 1\n"})
    assert not file.needs_restart
    said, advice = change_lines([file])
    assert said == "e.toml: comments or order only"
    assert advice.startswith("no restart is needed")


def test_a_file_that_was_edited_in_place_is_kept_and_its_bundle_skipped(
    office: Path, machine: Path
) -> None:
    """An editor may write through the link: then the state itself is no longer what was signed."""
    first = state(machine)
    assert applied(office, machine) == 0
    with (machine / "edge.toml").open("a") as file:
        file.write("# edited through the link\n")
    edited = state(machine)
    assert packed(office, "9.bundle", "--number", "9") == 0
    assert applied(office, machine, bundle="9.bundle") == 0
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert state(machine) == edited
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 0
    assert state(machine) == first
    assert main(["rollout", "back", str(machine / "edge.toml")]) == 2


@pytest.mark.parametrize("name", ["current/applied.json", "highest"])
@pytest.mark.parametrize("content", ["", "{", "\0", '{"number": "x"}', "[" * 100_000])
def test_a_damaged_folder_of_states_is_told_in_one_line(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str], name: str, content: str
) -> None:
    assert applied(office, machine) == 0
    assert packed(office, "9.bundle", "--number", "9") == 0
    (machine / "edge.toml.rollout" / name).write_text(content)
    before = everything(machine)
    bundle = [str(office / "9.bundle"), "--trust", str(office / "site.pem")]
    for line in (
        ["apply", *bundle, "--machine", "mill-1", str(machine / "edge.toml")],
        ["status", str(machine / "edge.toml")],
        ["back", str(machine / "edge.toml")],
    ):
        capsys.readouterr()
        assert main(["rollout", *line]) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert name.rpartition("/")[2] in said
    assert everything(machine) == before


def test_a_bundle_is_for_the_versions_that_it_states(
    office: Path, machine: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert packed(office, "next.bundle", "--number", "9", "--for", "98.7") == 0
    assert "is for edge-service 98.7; this is" in refused(office, machine, capsys, "next.bundle")
    assert packed(office, "both.bundle", "--number", "9", "--for", MINOR, "--for", "98.7") == 0
    assert applied(office, machine, bundle="both.bundle") == 0
