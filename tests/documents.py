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
    return (ROOT / path).read_text("utf-8")


def guide() -> str:
    """All that is written for those who run the service, whichever document it stands in."""
    own = {"deploy/CHANGELOG.md", "deploy/CONTRIBUTING.md"}
    pages = {path: text for path, text in documents().items() if path.startswith("deploy/")}
    return "\n".join(text for path, text in pages.items() if path not in own)


def blocks(text: str, language: str) -> list[str]:
    fenced = re.findall(r"^```(\w*)\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    return [content for named, content in fenced if named == language]


def block(path: str, language: str, containing: str) -> str:
    """First block in a language that contains some text, in a document or in the guide."""
    text = guide() if path == "guide" else document(path)
    return next(each for each in blocks(text, language) if containing in each)
