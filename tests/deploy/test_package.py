"""The Debian package holds what it should, and comes, is renewed and goes by Debian's policy."""

import os
import shutil
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.documents import ROOT, document, documents
from tests.programs import printed, ran

MACHINE = ROOT / "tests" / "deploy" / "machine.sh"
TOOLS = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
COMMAND = """#!program/bin/python3
import sys

from edge_service.cli.entry import main

sys.exit(main())
"""
CONFIGURATION = ("/etc/edge-service/commissioned.toml", "/etc/edge-service/edge.toml")


def run(line: list[str], **environment: str) -> str:
    """Standard output of a command that must succeed."""
    alone = {"PATH": TOOLS, "HOME": "/nowhere", "LC_ALL": "C.UTF-8"}
    return printed(*line, folder=ROOT, variables=alone, **environment)


def can_build() -> bool:
    tools = ("nfpm", "dpkg-deb")
    return all(shutil.which(e, path=TOOLS) for e in tools) and Path("/usr/bin/python3").exists()


def can_install(folder: Path) -> bool:
    """Return whether this user may lay a copy of the machine over the machine."""
    return ran("sh", MACHINE, folder, "true").returncode == 0


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Installed program that borrows its Python packages from this checkout, so as to be small."""
    if not can_build():
        pytest.skip("nfpm or Debian's python3 is not installed")
    folder = tmp_path_factory.mktemp("built") / "program"
    run([sys.executable, "-m", "venv", "--without-pip", str(folder)])
    here = next(folder.glob("lib/python3*/site-packages"))
    (here / "borrowed.pth").write_text(f"{ROOT}\n{sysconfig.get_path('purelib')}\n")
    for each in (folder / "bin").iterdir():
        if not each.is_symlink():
            each.unlink()
    command = folder / "bin" / "edge-service"
    command.write_text(COMMAND)
    command.chmod(0o755)
    return folder


@pytest.fixture(scope="module")
def packages(program: Path) -> tuple[Path, Path]:
    out = program.parent / "packages"
    for version in ("0.1.0", "0.2.0"):
        run(["sh", "deploy/package.sh", str(out), str(program)], VERSION=version)
    first, second = sorted(out.glob("edge-service_*.deb"))
    return first, second


def test_it_holds_program_command_unit_and_configuration(packages: tuple[Path, Path]) -> None:
    held = run(["dpkg-deb", "--contents", str(packages[0])])
    for path in (
        "/opt/edge-service/bin/edge-service",
        "/usr/bin/edge-service -> /opt/edge-service/bin/edge-service",
        "/lib/systemd/system/edge-service.service",
        "/usr/share/doc/edge-service/examples/drivers/modbus.toml",
        *(f"/usr/share/doc/edge-service/{each}" for each in documents()),
        *CONFIGURATION,
    ):
        assert f" .{path}\n" in held, path
    assert "/usr/bin/edge-service" in document("deploy/edge-service.service")


def test_its_configuration_is_that_of_an_administrator(packages: tuple[Path, Path]) -> None:
    assert run(["dpkg-deb", "--info", str(packages[0]), "conffiles"]).split() == [*CONFIGURATION]


def test_lintian_finds_nothing(packages: tuple[Path, Path]) -> None:
    if shutil.which("lintian") is None:
        pytest.skip("lintian is not installed")
    line = ["lintian", "--allow-root", "--fail-on", "error,warning", str(packages[0])]
    assert run(line) == ""


@pytest.mark.slow
@pytest.mark.usefixtures("program")
def test_one_command_builds_wheel_and_package_with_every_document(tmp_path: Path) -> None:
    run(["sh", "deploy/package.sh", str(tmp_path)])
    (wheel,), (package,) = tmp_path.glob("*.whl"), tmp_path.glob("*.deb")
    held = run([sys.executable, "-m", "zipfile", "--list", str(wheel)])
    held += run(["dpkg-deb", "--contents", str(package)])
    for path in documents():
        assert held.count(f"share/doc/edge-service/{path}") == 2, path


COURSE = """set -e
ours() { find /etc /opt /usr /var -path '*edge-service*' ! -path '/var/lib/dpkg/*' | sort; }
check() { edge-service check-config /etc/edge-service/edge.toml | tail -n 1; }
before=$(ours)
dpkg --install {first} >/dev/null
check
echo '# mine' >>/etc/edge-service/edge.toml
echo kept >/var/lib/edge-service/kept
dpkg --install {second} >/dev/null
check
stat -c %U:%a /var/lib/edge-service
dpkg --remove edge-service >/dev/null
tail -n 1 /etc/edge-service/edge.toml
cat /var/lib/edge-service/kept
test ! -e /opt/edge-service -a ! -e /usr/bin/edge-service
echo '# written by init' >/etc/edge-service/machine.toml
dpkg --purge edge-service >/dev/null 2>&1
test "$before" = "$(ours)"
echo nothing left
"""


@pytest.mark.slow
def test_it_comes_is_renewed_and_goes(packages: tuple[Path, Path]) -> None:
    """An upgrade and a removal keep configuration and data; purging leaves nothing."""
    folder = packages[0].parent
    if not can_install(folder):
        pytest.skip("this user may not mount a copy of the machine")
    first, second = packages
    course = COURSE.replace("{first}", str(first)).replace("{second}", str(second))
    said = run(["sh", str(MACHINE), str(folder), course])
    right = "configuration is right"
    kept = ("# mine", "kept")
    assert said.splitlines() == [right, right, "edge-service:750", *kept, "nothing left"]
