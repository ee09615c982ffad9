"""The systemd unit is one that systemd takes, and takes from the service what it never needs."""

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.documents import ROOT, document
from tests.programs import ran

UNIT = ROOT / "deploy" / "edge-service.service"
ANALYZE = shutil.which("systemd-analyze")
MOST_EXPOSED = 2.5
"""Of 10; below it systemd calls a service well protected."""

needs_systemd = pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze is not installed")


def analysed(*arguments: str) -> "subprocess.CompletedProcess[str]":
    return ran("systemd-analyze", *arguments, SYSTEMD_PAGER="")


@needs_systemd
def test_systemd_takes_the_unit(tmp_path: Path) -> None:
    """With a program that is there, as on a machine where it is installed."""
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text().replace("/usr/bin/edge-service", "/bin/true"))
    checked = analysed("verify", str(unit))
    assert (checked.returncode, checked.stderr) == (0, "")


@needs_systemd
def test_the_service_is_little_exposed() -> None:
    bound = f"--threshold={MOST_EXPOSED * 10:.0f}"
    checked = analysed("security", "--offline=true", bound, str(UNIT))
    assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_unit_leaves_what_the_service_needs() -> None:
    """Kernels are compiled, and jobs bound their own memory and priority."""
    unit = configparser.ConfigParser(strict=False, interpolation=None)
    unit.optionxform = str  # type: ignore[assignment,method-assign]
    unit.read_string(document("deploy/edge-service.service"))
    service = unit["Service"]
    assert "MemoryDenyWriteExecute" not in service
    assert "@resources" not in service["SystemCallFilter"]
    assert {"AF_INET", "AF_INET6", "AF_UNIX"} <= set(service["RestrictAddressFamilies"].split())
