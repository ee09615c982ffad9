"""Prometheus' alert rules fire on what the service really says, and are explained."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from edge_service.messages.estimate import EstimateStatus
from edge_service.messages.health import AlarmKind
from edge_service.outputs.metrics import family_names
from tests.documents import document, guide
from tests.programs import ran

RULES = document("deploy/alerts.yml")
ALERTS = re.findall(r"- alert: (\w+)", RULES)
PROMTOOL = shutil.which("promtool")

needs_promtool = pytest.mark.skipif(PROMTOOL is None, reason="promtool is not installed")


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
