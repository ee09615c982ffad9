"""`--help` of every command is what the table of the command room says."""

import re

import click
import pytest
from click.testing import CliRunner

from edge_service.cli.entry import GROUPS, cli, summary

from .bench.commands import bench
from .documents import document

ROW = re.compile(
    r"^\| (?:\*\*(.+)\*\*|`edge-service ([a-z-]+) ?(.*?)`) \| (.*?) ?\| (?:`(.*)` )?\|$"
)
SHARED = ("--help", "--json")
MOST_OPTIONS, MOST_COMMANDS, MOST_CHARACTERS = 80, 26, 70


def table() -> dict[str, list[tuple[str, str, str, set[str]]]]:
    """Group -> command, arguments, summary and options of each row."""
    groups: dict[str, list[tuple[str, str, str, set[str]]]] = {}
    for line in document("edge_service/cli/README.md").splitlines():
        if (found := ROW.match(line)) is None:
            continue
        title, name, arguments, words, options = found.groups()
        if title:
            groups[title] = []
        elif groups:
            row = name, arguments, words, set((options or "").split())
            list(groups.values())[-1].append(row)
    return groups


def options_of(command: click.Command) -> set[str]:
    options = (each for each in command.params if isinstance(each, click.Option))
    return {name for each in options for name in each.opts if name.startswith("--")}


ROWS = [row for rows in table().values() for row in rows]


def test_groups_and_commands_are_those_of_the_table() -> None:
    shown = {title: [row[0] for row in rows] for title, rows in table().items()}
    assert shown == {title: [each.name for each in group] for title, group in GROUPS.items()}
    hidden = {name for name, each in cli.commands.items() if each.hidden}
    assert hidden == {"help", "version", "drift"}
    assert {row[0] for row in ROWS} | hidden == set(cli.commands)
    assert len(ROWS) <= MOST_COMMANDS


@pytest.mark.parametrize(("name", "arguments", "words", "options"), ROWS, ids=lambda row: row)
def test_help_says_what_the_table_says(
    name: str, arguments: str, words: str, options: set[str]
) -> None:
    command = cli.commands[name]
    assert summary(command) == words
    assert len(words) <= MOST_CHARACTERS
    if command.name == "bench":
        assert options <= options_of(bench)
        return
    context = click.Context(command, info_name=name)
    told = command.collect_usage_pieces(context)
    assert " ".join(told).removeprefix("[OPTIONS]").strip() == arguments
    assert options_of(command) - set(SHARED) == options


def test_options_are_few() -> None:
    defined = {
        (option, each.help)
        for command in cli.commands.values()
        for each in command.params
        if isinstance(each, click.Option)
        for option in each.opts
    }
    assert len(defined) <= MOST_OPTIONS


def test_the_list_has_whole_summaries() -> None:
    said = CliRunner().invoke(cli, ["--help"]).output
    for title, rows in table().items():
        assert f"\n{title}:\n" in said
        for name, _, words, _ in rows:
            assert f"  {name:<16}{words}\n" in said
    assert said.endswith("`edge-service help COMMAND` shows options and an example.\n")


def test_help_and_version_work() -> None:
    said = CliRunner().invoke(cli, ["help", "estimate"]).output
    assert said == CliRunner().invoke(cli, ["estimate", "--help"]).output
    assert CliRunner().invoke(cli, ["help"]).output == CliRunner().invoke(cli, ["--help"]).output
    assert CliRunner().invoke(cli, ["version"]).output.startswith("edge-service, version ")
