"""Words for readers: the glossary is that of the page, and no code lacks its line of what to do."""

import ast
import re
from collections.abc import Iterator
from inspect import isclass

import pytest
from pydantic import BaseModel, ValidationError

from edge_service.config import EdgeConfig
from edge_service.config.mistakes import explain
from edge_service.messages.health import Task

from .documents import ROOT, document
from .page.test_language import CODES, words

GLOSSARY, TROUBLES = "deploy/GLOSSARY.md", "deploy/TROUBLESHOOTING.md"
CODE = re.compile(r"^([a-z]+(?:_[a-z]+)*): ")
TOLD_WITH_CODES = ("estimate", "health", "nodes")
NO_REASONS = {"boundary", "covariance", "drive", "filterpy", "mode_probability", "mode_transition"}
NO_REASONS |= {"snapshot", "step", "step_s", "axes"}
"""Beginnings of errors of the code, which no reader sees: names of arguments."""


def rows(path: str, heading: str) -> list[list[str]]:
    """Cells of the table under a heading."""
    section = document(path).partition(f"\n## {heading}\n")[2].partition("\n## ")[0]
    lines = [line for line in section.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]


def parts(cell: str) -> list[str]:
    """Words of a cell that stand for themselves: between commas, without quotation marks."""
    return [part.strip('" ').lower() for part in re.split(r'",? |, ', cell) if part.strip('" ')]


@pytest.mark.parametrize(("language", "cell"), [("en", 0), ("de", 1)])
def test_every_word_of_the_pages_glossary_is_on_the_page(language: str, cell: int) -> None:
    said = "\n".join(words(language).values()).lower()
    table = rows(GLOSSARY, "On the page")
    assert len(table) > 20
    for row in table:
        for part in parts(row[cell]):
            assert part in said, part


def codes_told() -> Iterator[str]:
    """Codes with which the service begins a reason, wherever in it."""
    for room in TOLD_WITH_CODES:
        for path in (ROOT / "edge_service" / room).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    match = CODE.match(node.value)
                    if match and "\n" not in node.value:
                        yield match.group(1)


def test_every_reason_has_its_line() -> None:
    codes = {key.removeprefix("reason.") for key in words("en") if key.startswith("reason.")}
    codes |= set(codes_told()) - NO_REASONS
    assert codes > {"no_motion", "silent", "model_mismatch", "learning"}
    known = "".join(row[0] for row in rows(TROUBLES, "Reasons"))
    assert {code for code in codes if f"`{code}`" not in known} == set()


HEADINGS = {
    "alarm": "Alarms",
    "task": "Tasks",
    "part": "Parts of the service",
    "component": "Parts of the service",
    "fault": "Faulty data",
}


@pytest.mark.parametrize("kind", HEADINGS)
def test_every_code_has_its_line(kind: str) -> None:
    codes = {**CODES, "task": Task}
    known = "".join(row[0] for row in rows(TROUBLES, HEADINGS[kind]))
    assert {code for code in codes[kind] if f"`{code}`" not in known} == set()


def test_every_message_that_is_explained_exists() -> None:
    sources = [path.read_text("utf-8") for path in ROOT.glob("edge_service/**/*.py")]
    code = re.sub(r'"\n\s+f?"', "", "\n".join(sources))
    messages = [row[0].strip("`") for row in rows(TROUBLES, "Messages of commands")]
    assert len(messages) > 3
    assert {message for message in messages if message not in code} == set()


AXES = [{"name": "X", "machine": "machine.toml", "driver": "simulated"}]
TABLES = [name for name, field in EdgeConfig.model_fields.items() if isclass(field.annotation)]


@pytest.mark.parametrize("table", TABLES)
def test_a_key_without_its_table_is_told_where_it_belongs(table: str) -> None:
    model = EdgeConfig.model_fields[table].annotation
    assert isclass(model)
    assert issubclass(model, BaseModel)
    for key in model.model_fields.keys() - EdgeConfig.model_fields.keys():
        with pytest.raises(ValidationError) as caught:
            EdgeConfig.model_validate({"axes": AXES, key: 1})
        said = explain(caught.value, EdgeConfig)[0]
        assert said.startswith(f"{key}: unknown key here; it belongs under ")
        assert f"[{table}]" in said
