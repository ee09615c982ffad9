"""The project's documents, as readers of the checkout find them."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
ROOMS = ("edge_service", "drivers", "tests", "deploy")


def documents() -> dict[str, str]:
    """Path within the checkout -> text, for every document."""
    paths = [ROOT / "README.md"]
    for room in ROOMS:
        paths += sorted((ROOT / room).rglob("*.md"))
    return {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in paths}


def document(path: str) -> str:
    """Text of one document."""
    return (ROOT / path).read_text("utf-8")


def blocks(text: str, language: str) -> list[str]:
    """Fenced blocks of a language, in order."""
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [content for named, content in fenced if named == language]


def block(path: str, language: str, containing: str) -> str:
    """First block of a document in a language that contains some text."""
    found = (each for each in blocks(document(path), language) if containing in each)
    return next(found)
