"""Documents say what is so: links, pictures, commands, options, figures; their programs work."""

import ast
import asyncio
import json
import re
import subprocess
import sys
import tomllib
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import fields
from pathlib import Path

import click
import pytest

from edge_service import exit_status
from edge_service.checks.live.channel_check import channel_reasons
from edge_service.cli.entry import cli
from edge_service.messages.features import Fault
from edge_service.messages.health import AlarmKind
from edge_service.messages.samples import ColumnMap, Quality
from edge_service.models.machine import (
    AxisConfig,
    EffectConfig,
    Machine,
    ModelConfig,
    ToleranceConfig,
)
from edge_service.outputs.metrics import family_names

from .bench.commands import bench
from .documents import ROOT, block, blocks, document, documents, guide
from .nodes.conftest import config_of, running

FIRST_PAGE_LINES, FIRST_PAGE_COMMANDS = 120, 12
FIRST_COMMANDS = ["sh deploy/demo.sh", "sh deploy/check.sh"]
MOST_WORDS = 25_000
"""Of all pages: what has a letter in it, outside of blocks."""
PATHS = sorted(documents())
ROOMS = [path.parent for path in ROOT.glob("edge_service/*/__init__.py")]
HOUSES = [ROOT / "edge_service", ROOT / "drivers", ROOT / "tests" / "bench"]
UNNAMED = ("__", "conftest")
COMMAND = re.compile(r"edge-service ([a-z][a-z-]*)")
OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]*")
OTHERS = re.compile(r"^\S*(uv|git|pip|python|prometheus|curl|systemctl|docker) |^# |^\s*--hash")
"""Commands of other programs."""


def test_the_first_page_is_short() -> None:
    text = document("README.md")
    assert len(text.splitlines()) <= FIRST_PAGE_LINES
    commands = re.findall(r"(?m)^(?:sh|curl|edge-service) .+|`edge-service [a-z-]+ [^`\n]+`", text)
    assert [each.split("  ")[0] for each in commands[:2]] == FIRST_COMMANDS
    assert len(commands) <= FIRST_PAGE_COMMANDS


def test_the_pages_are_no_longer_than_somebody_reads() -> None:
    prose = " ".join(unblocked(document(path)) for path in PATHS)
    assert sum(re.search("[A-Za-z]", word) is not None for word in prose.split()) <= MOST_WORDS


@pytest.mark.parametrize("room", [*ROOMS, *HOUSES], ids=lambda path: path.name)
def test_every_room_has_a_readme_that_names_all_in_it(room: Path) -> None:
    text = document((room / "README.md").relative_to(ROOT).as_posix())
    for path in room.iterdir():
        if path.is_dir() and any(path.rglob("*.py")):
            named = (f"`{path.name}/`", f"`{path.name}`", f"[{path.name}]", f"/{path.name}/")
            assert any(name in text for name in named), path
        elif path.suffix == ".py" and not path.name.startswith(UNNAMED):
            assert f"`{path.name}`" in text, path


@pytest.mark.parametrize("room", [*ROOMS, ROOT / "drivers"], ids=lambda path: path.name)
def test_every_room_states_its_bounds_and_how_it_grows(room: Path) -> None:
    text = document((room / "README.md").relative_to(ROOT).as_posix())
    for part in (r"\b(may\s+know|knows)\b", r"^(## Limits|Limits: )", r"^(## |\*\*)Adding an? "):
        assert re.search(part, text, re.MULTILINE), part


def test_every_document_is_linked_from_another() -> None:
    linked = {
        (ROOT / path).parent.joinpath(target.partition("#")[0]).resolve()
        for path, text in documents().items()
        for target in links(text)
    }
    for path in set(PATHS) - {"README.md"}:
        assert (ROOT / path).resolve() in linked, path


def unblocked(text: str) -> str:
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def links(text: str) -> list[str]:
    """Relative targets of links and pictures outside of blocks."""
    targets = re.findall(r"\]\(([^)\s]+)\)", unblocked(text))
    return [target for target in targets if not re.match(r"[a-z]+:", target)]


def anchors(text: str) -> set[str]:
    """Anchors of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", unblocked(text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


@pytest.mark.parametrize("path", PATHS)
def test_every_link_and_picture_leads_somewhere(path: str) -> None:
    for target in links(document(path)):
        file, _, anchor = target.partition("#")
        found = (ROOT / path).parent / file if file else ROOT / path
        assert found.exists(), target
        if anchor:
            assert anchor in anchors(found.read_text("utf-8")), target


@pytest.mark.parametrize("path", PATHS)
def test_every_file_that_a_document_names_exists(path: str) -> None:
    spans = re.findall(r"`((?:deploy|tests|drivers|edge_service)/[\w./*-]+)`", document(path))
    for span in spans:
        assert list(ROOT.glob(span.rstrip("/"))), span


@pytest.mark.parametrize("path", PATHS)
def test_every_block_is_whole(path: str) -> None:
    text = document(path)
    for each in blocks(text, "python"):
        compile(each, path, "exec")
    for each in blocks(text, "toml"):
        tomllib.loads(each)
    for each in blocks(text, "json"):
        json.loads(each)


def command_of(match: re.Match[str]) -> click.Command | None:
    return bench if match[1] == "bench" else cli.commands.get(match[1])


def options_of(commands: list[click.Command | None]) -> set[str]:
    return {"--help"} | {
        option
        for command in commands
        if command is not None
        for parameter in command.params
        for option in parameter.opts
    }


def passages(text: str) -> Iterator[list[str]]:
    """Lines of each block, or the code spans of each paragraph, list item or row of a table."""
    text = re.sub(r"\\\n\s*", " ", text).replace("sh deploy/demo.sh", "edge-service run")
    for content, prose in re.findall(
        r"^```\w*\n(.*?)^```$|(.+?)(?=^```|\Z)", text, re.DOTALL | re.MULTILINE
    ):
        yield content.splitlines()
        for each in re.split(r"\n\s*\n|\n(?=[|*]|\d+\. )", prose):
            yield [" ".join(span.split()) for span in re.findall(r"`([^`]+)`", each)]


def wrong_uses(parts: list[str]) -> list[str]:
    """Commands that do not exist, and options that the commands named beside them do not have."""
    own = [part for part in parts if not OTHERS.search(part)]
    near = [match for part in own for match in COMMAND.finditer(part)]
    wrong = [match.group(0) for match in near if command_of(match) is None]
    for part in own:
        named = list(COMMAND.finditer(part)) or near
        known = options_of([command_of(match) for match in named])
        wrong += [f"{option}: {part}" for option in OPTION.findall(part) if option not in known]
    return wrong


@pytest.mark.parametrize("path", PATHS)
def test_every_command_and_option_that_a_document_names_exists(path: str) -> None:
    for parts in passages(document(path)):
        assert wrong_uses(parts) == []


def test_every_key_of_a_machine_file_stands_in_the_operators_guide() -> None:
    text = guide()
    example = Machine.model_validate(tomllib.loads(block("deploy/README.md", "toml", "lead_m")))
    assert example.columns["torque_command_nm"].column == "u_V"
    tables = (AxisConfig, ModelConfig, ToleranceConfig, EffectConfig, Machine)
    keys = {key for table in tables for key in table.model_fields}
    for key in keys | {each.name for each in fields(ColumnMap)}:
        assert re.search(rf"\b{key}\b", text), key


def test_every_quality_of_a_sample_is_explained() -> None:
    table = re.search(r"(?m)^\| quality .+\n(\|.+\n)+", document("drivers/README.md"))
    assert table
    named = set(re.findall(r"`(\w+)`", table.group()))
    assert named == {each.name.lower() for each in Quality} - {"good"}


def schemas() -> set[str]:
    """Names with a version that the product writes."""
    return {
        node.value
        for path in ROOT.glob("edge_service/**/*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if re.fullmatch(r"[a-z]+(?:-[a-z]+)*/\d+", node.value)
    }


STATUSES = [value for value in vars(exit_status).values() if isinstance(value, int)]
FAMILIES = [name.removeprefix("edge_service_") for name in family_names()]
REASONS = {reason.partition(":")[0] for fault in Fault for reason in channel_reasons(fault)}
EXPLAINED = {
    "metrics": ("guide", "`{}[`{{]", FAMILIES),
    "exit statuses": ("guide", r"(?m)^\| {} \| ", STATUSES),
    "alarms": ("guide", "`{}`", [kind.value for kind in AlarmKind]),
    "reasons": ("guide", "`{}`", REASONS),
    "schemas": ("edge_service/messages/README.md", "`{}`", schemas()),
}
"""Names -> the document or guide where each stands, and how."""


@pytest.mark.parametrize("kind", EXPLAINED)
def test_every_name_is_explained(kind: str) -> None:
    place, form, names = EXPLAINED[kind]
    text = guide() if place == "guide" else document(place)
    assert len(names) >= 5
    assert [name for name in names if not re.search(form.format(name), text)] == []


def test_the_unit_of_systemd_calls_commands_that_exist() -> None:
    calls = re.findall(r"(?m)^Exec\w+=.*edge-service.+$", document("deploy/edge-service.service"))
    assert len(calls) == 2
    for call in calls:
        match = COMMAND.search(call)
        assert match
        assert command_of(match)
        assert set(OPTION.findall(call)) <= options_of([command_of(match)])
    assert f"RestartPreventExitStatus={exit_status.BAD_INPUT}" in document(
        "deploy/edge-service.service"
    )


def test_the_licence_is_the_one_that_the_project_states() -> None:
    project = tomllib.loads(document("pyproject.toml"))["project"]
    assert (project["license"], project["license-files"]) == ("Apache-2.0", ["LICENSE"])
    assert "Apache License\n                           Version 2.0" in document("LICENSE")
    assert f"## {project['version']}\n" in document("deploy/CHANGELOG.md")
    assert project["readme"] == "README.md"


@asynccontextmanager
async def lines_of(source: str) -> AsyncIterator[asyncio.StreamReader]:
    """Lines that a program prints beside a service, for a minute at most."""
    config = config_of("simulated", {"scenario": "healthy", "speed": 20.0})
    async with running(config, ("acquire", "downsample", "estimate")) as service:
        program = await asyncio.create_subprocess_exec(
            sys.executable, "-I", "-c", source, service.bus.endpoint, stdout=subprocess.PIPE
        )
        assert program.stdout is not None
        try:
            async with asyncio.timeout(60.0):
                yield program.stdout
        finally:
            program.kill()
            await program.wait()


async def test_the_client_of_the_readme_hears_samples_and_preload() -> None:
    heard = set[str]()
    async with lines_of(block("edge_service/bus/README.md", "python", "zenoh.open")) as lines:
        while not heard >= {"torque", "preload"}:
            heard.add((await lines.readline()).decode().split()[0])
    assert heard == {"torque", "preload"}


async def test_the_bridge_of_the_guide_prints_the_line_protocol() -> None:
    line = ""
    async with lines_of(block("guide", "python", "preload,site=")) as lines:
        while 'status="estimated"' not in line:
            line = (await lines.readline()).decode()
            assert re.match(r"preload,site=bench,machine=lfd,axis=X status=", line)
    fields = re.search(r"preload_percent=([0-9.]+),low=([0-9.]+),high=([0-9.]+) [0-9]{19}$", line)
    assert fields
    value, low, high = map(float, fields.groups())
    assert low <= value <= high
