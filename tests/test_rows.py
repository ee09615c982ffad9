"""Each row of the thesis and of the request works: its command says what stands there."""

import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from edge_service.cli.entry import cli
from edge_service.config import load_config
from edge_service.config.service import BusConfig, HttpConfig

from .documents import ROOT, document
from .nodes.conftest import served, until
from .offline.test_convert import trace_xml


def rows() -> list[tuple[str, str, str]]:
    """Row, command or route, and what that says; a row without a call has that of the one above."""
    found, last = [], ""
    section = document("edge_service/cli/README.md").partition("## The thesis and the request")[2]
    for line in section.partition("\n## ")[0].split("|---|\n")[1].splitlines():
        row, call, said = (cell.strip(" `") for cell in line.strip("|").split("|"))
        last = call or last
        found.append((row, last, said))
    return found


ROWS = rows()


def test_there_are_61_rows_of_63_with_a_command_that_says_something() -> None:
    assert len(ROWS) == len({row for row, _, _ in ROWS}) == 63
    working = [call for _, call, said in ROWS if said]
    assert len(working) == sum(call.startswith(("/", "edge-service ")) for call in working) == 61


def test_the_steps_of_the_front_page_are_rows_in_their_order() -> None:
    steps = document("README.md").partition("## Five steps")[2].partition("\n## ")[0]
    commands = re.findall(r"`(edge-service [a-z]+ .+?)`", steps)
    calls = [call for _, call, _ in ROWS]
    assert len(commands) == 6
    assert [calls.index(each) for each in commands] == sorted(map(calls.index, commands))


@pytest.mark.slow
def test_every_command_of_a_row_says_what_stands_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("deploy").symlink_to(ROOT / "deploy")
    Path("m.toml").write_bytes(Path("deploy/machine.toml").read_bytes())
    Path("trace.xml").write_text(trace_xml())
    Path("force.csv").write_text("time_s,force_n\n0,-200\n9,-200\n")
    printed: dict[str, str] = {}
    for row, call, said in ROWS:
        if call.startswith("edge-service "):
            if call not in printed:
                done = CliRunner().invoke(cli, shlex.split(call)[1:])
                assert done.exit_code == 0, (row, done.output)
                printed[call] = " ".join(done.output.split())
            assert said in printed[call], (row, printed[call])


async def test_every_route_of_a_row_says_what_stands_there() -> None:
    places = {"bus": BusConfig(endpoint="tcp/127.0.0.1:0"), "http": HttpConfig(port=0)}
    config = load_config(ROOT / "deploy" / "edge.toml").model_copy(update=places)
    async with served(config) as (_, client):
        for _, call, said in ROWS:
            if call.startswith("/"):

                async def is_said(route: str = call, said: str = said) -> bool:
                    return said in (await client.get(route)).text

                await until(is_said)
