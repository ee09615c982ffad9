"""The play that configures many machines: its steps, in the order that keeps a machine working."""

from typing import Any

import yaml

from edge_service.cli.entry import cli

from ..documents import ROOT

FOLDER = ROOT / "deploy" / "ansible"


def module_of(task: dict[str, Any]) -> str:
    return next(key for key in task if key.startswith("ansible.builtin."))


def test_nothing_is_put_in_place_before_it_was_checked_on_hosts_of_the_inventory() -> None:
    (play,) = yaml.safe_load((FOLDER / "configure.yml").read_text())
    tasks = play["tasks"]
    assert all(module_of(task) and task["name"] for task in (*tasks, *play["handlers"]))
    (check,) = (n for n, task in enumerate(tasks) if "check-config" in str(task))
    (place,) = (n for n, task in enumerate(tasks) if "notify" in task)
    assert check < place
    assert tasks[place]["notify"] in {handler["name"] for handler in play["handlers"]}
    program, command, _ = tasks[check]["ansible.builtin.command"].split()
    assert (program, command in cli.commands) == ("edge-service", True)
    assert yaml.safe_load((FOLDER / "hosts.yml").read_text())[play["hosts"]]["hosts"]
