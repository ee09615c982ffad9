"""Files for other programs: systemd's unit, the play that configures many machines, alert rules."""

import configparser
import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from edge_service.cli.entry import cli
from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.health import AlarmKind
from edge_service.outputs.metrics import family_names
from tests.documents import ROOT, document, guide
from tests.programs import ran

UNIT = ROOT / "deploy" / "edge-service.service"
ANALYZE = shutil.which("systemd-analyze")
MOST_EXPOSED = 2.5
"""Of 10; below it systemd calls a service well protected."""

needs_systemd = pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze is not installed")
FOLDER = ROOT / "deploy" / "ansible"
RULES = document("deploy/alerts.yml")
ALERTS = re.findall(r"- alert: (\w+)", RULES)
PROMTOOL = shutil.which("promtool")
needs_promtool = pytest.mark.skipif(PROMTOOL is None, reason="promtool is not installed")


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


def test_nothing_is_put_in_place_before_it_was_checked_on_hosts_of_the_inventory() -> None:
    (play,) = yaml.safe_load((FOLDER / "configure.yml").read_text())
    tasks = play["tasks"]
    for task in (*tasks, *play["handlers"]):
        assert task["name"]
        assert any(key.startswith("ansible.builtin.") for key in task)
    (check,) = (n for n, task in enumerate(tasks) if "check-config" in str(task))
    (place,) = (n for n, task in enumerate(tasks) if "notify" in task)
    assert check < place
    assert tasks[place]["notify"] in {handler["name"] for handler in play["handlers"]}
    program, command, _ = tasks[check]["ansible.builtin.command"].split()
    assert (program, command in cli.commands) == ("edge-service", True)
    assert yaml.safe_load((FOLDER / "hosts.yml").read_text())[play["hosts"]]["hosts"]


def judged(folder: Path, rules: str) -> "subprocess.CompletedProcess[str]":
    (folder / "alerts.yml").write_text(rules)
    (folder / "tests.yml").write_text(document("tests/deploy/alerts_test.yml"))
    return ran("promtool", "test", "rules", "tests.yml", folder=folder)


@needs_promtool
def test_rules_fire_when_they_should(tmp_path: Path) -> None:
    checked = judged(tmp_path, RULES)
    assert checked.returncode == 0, checked.stdout + checked.stderr


@needs_promtool
@pytest.mark.slow
@pytest.mark.parametrize("alert", ALERTS)
def test_a_rule_that_never_fires_is_found(tmp_path: Path, alert: str) -> None:
    mute = re.sub(rf"(- alert: {alert}\n\s+expr: ).*", r"\1vector(1) > 2", RULES)
    assert judged(tmp_path, mute).returncode == 1


def test_rules_ask_only_for_what_is_there() -> None:
    asked = set(re.findall(r"edge_service_[a-z_]+", RULES))
    assert asked <= set(family_names())


def test_rules_ask_only_for_labels_that_exist() -> None:
    known = {
        "alarm": {each.value for each in AlarmKind},
        "status": {each.value for each in EstimateStatus},
        "bound": {"earliest", "likely", "latest"},
        "state": {"active", "dead"},
        "reason": {"refused"},
        "job": {"edge-service"},
    }
    for label, value in re.findall(r'(\w+)!?="([\w-]+)"', RULES):
        assert value in known[label], (label, value)


def test_every_rule_stands_in_the_guide() -> None:
    text = guide()
    assert ALERTS
    for alert in ALERTS:
        assert f"| `{alert}` |" in text, alert
