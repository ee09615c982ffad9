"""Documents that are carried out: what they tell to type and to save, and what they say comes.

In the order of the document, in one folder and one shell: a block `toml` whose sentence before it
ends in a file's name is saved under it; a block `sh` is run; a block `text` is an excerpt of what
the commands before it print, in which `...` stands for anything and blanks for any blanks.
"""

import contextlib
import os
import re
import signal
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_SAVED = re.compile(r"`([\w.-]+)`:\s*\Z")


@dataclass(frozen=True, slots=True)
class Step:
    """One block of commands, with the files saved before it and the excerpt that follows it."""

    commands: str
    files: Mapping[str, str]
    excerpt: str | None


def steps(text: str) -> list[Step]:
    found: list[Step] = []
    files: dict[str, str] = {}
    for match in _BLOCK.finditer(text):
        language, content = match.groups()
        name = _SAVED.search(text[: match.start()])
        if language == "sh":
            found.append(Step(content, files, None))
            files = {}
        elif language == "text":
            found[-1] = Step(found[-1].commands, found[-1].files, content)
        elif name:
            files[name.group(1)] = content
    return found


def script(tour: list[Step]) -> str:
    """One shell script: each step's output goes to a file of its number, and a failure ends it."""
    lines = ["set -e"]
    for number, step in enumerate(tour):
        lines.append(f"exec >{number}.out 2>&1")
        for name, content in step.files.items():
            lines.append(f"cat >{name} <<'END OF FILE'\n{content}END OF FILE")
        lines.append(step.commands)
    return "\n".join(lines)


def carry_out(tour: list[Step], folder: Path, environment: Mapping[str, str]) -> list[str]:
    """Run a tour; what still runs at its end is ended with it.

    Returns:
        What is not as the document says, one text per step; empty if all of it is.
    """
    shell = subprocess.Popen(
        ["sh", "-c", script(tour)],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        status = shell.wait(timeout=600.0)
    finally:
        with contextlib.suppress(ProcessLookupError):  # nothing was left running
            os.killpg(shell.pid, signal.SIGKILL)
    said = [_said(folder / f"{number}.out") for number in range(len(tour))]
    wrong = [_difference(step, text) for step, text in zip(tour, said, strict=True)]
    failure = [f"status {status}, the last words:\n{''.join(said)[-2000:]}"] if status else []
    return failure + [each for each in wrong if each]


def _said(path: Path) -> str:
    return path.read_text("utf-8") if path.exists() else ""


def _difference(step: Step, said: str) -> str:
    if step.excerpt is None or _pattern(step.excerpt).search(" ".join(said.split())):
        return ""
    return f"{step.commands}\nwas said to print\n{step.excerpt}\nand printed\n{said}"


def _pattern(excerpt: str) -> re.Pattern[str]:
    parts = " ".join(excerpt.split()).split("...")
    return re.compile(".*?".join(re.escape(part.strip()) for part in parts))
