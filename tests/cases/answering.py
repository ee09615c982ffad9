"""Ask the question of a case, and hold what is answered against what is expected."""

import asyncio
import contextlib
import csv
import io
import json
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx

from edge_service.cli.entry import main

from ..http_api.conftest import Scene, client_of
from .assertions import assert_holds
from .case_file import Answer, Case, Refusal, Window, load_case, load_expected
from .recipes import Store


@dataclass(frozen=True, slots=True)
class Outcome:
    """End of a case: status, what stood on stderr, and the answer as plain objects."""

    status: int
    stderr: str
    answer: Any = None


def check(home: Path, store: Store, folder: Path) -> None:
    """Run the case of a folder; an answer that is not as expected is an `AssertionError`."""
    case, expected = load_case(home), load_expected(home)
    outcome = asked(case) if case.request else ran(case, home, store, folder)
    if isinstance(expected, Refusal):
        assert_refused(outcome, expected)
    else:
        assert_answered(outcome, expected)


def assert_refused(outcome: Outcome, expected: Refusal) -> None:
    """One line on stderr, as expected, and the exit status."""
    assert outcome.status == expected.status, f"status {outcome.status}: {outcome.stderr}"
    lines = outcome.stderr.splitlines()
    assert len(lines) == 1, f"one line is wanted on stderr: {outcome.stderr!r}"
    if expected.pattern is None:
        assert lines[0] == expected.line
    else:
        assert re.search(expected.pattern, lines[0]), f"{expected.pattern!r}: {lines[0]!r}"


def assert_answered(outcome: Outcome, expected: Answer) -> None:
    """Every assertion on the answer, or the refusal that would do as well."""
    if expected.or_refused is not None and outcome.status == 2:
        assert_refused(outcome, Refusal(pattern=expected.or_refused))
        return
    assert outcome.status == expected.status, f"status {outcome.status}: {outcome.stderr}"
    for assertion in expected.answer:
        assert_holds(assertion, outcome.answer)


def ran(case: Case, home: Path, store: Store, folder: Path) -> Outcome:
    """Run the commands; the last one answers, or the first that does not end with 0."""
    named = {name: store.trace(recipe) for name, recipe in case.traces.items()}
    named |= {"machine": [store.machine(case, home)], "out": [folder / "out"], "folder": [folder]}
    for line in case.run:
        command = list(_words(line, named))
        stdout, stderr = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(stdout), contextlib.redirect_stderr(stderr):
            status = main(command)
        if status != 0:
            break
    said = _with_placeholders(stderr.getvalue(), named)
    return Outcome(status, said, _answer(command[0], folder / "out", stdout, case))


def _words(line: str, named: dict[str, list[Path]]) -> Iterator[str]:
    """Words of a command; a placeholder of several files is several words."""
    for word in line.split():
        paths = named.get(word[1:-1]) if word[0] == "{" and word[-1] == "}" else None
        if paths is not None:
            yield from map(str, paths)
        else:
            yield word.format(**{name: paths[0] for name, paths in named.items()})


def _with_placeholders(text: str, named: dict[str, list[Path]]) -> str:
    """Line on stderr, with `{trace}` for the path of the trace."""
    for name, paths in named.items():
        if name != "folder":
            text = text.replace(str(paths[0]), f"{{{name}}}")
    return text


def _answer(command: str, out: Path, stdout: io.StringIO, case: Case) -> Any:
    """File that the command left, or its JSON on stdout; None where there is neither."""
    if command == "estimate" and out.exists():
        return estimates(out, case.windows)
    if command == "commission" and out.exists():
        return tomllib.loads(out.read_text())
    file = out / f"{'diagnosis' if command == 'diagnose' else command}.json"
    text = file.read_text() if file.exists() else stdout.getvalue()
    said = {"said": stdout.getvalue()} if command in ("diagnose", "gap") else {}
    return json.loads(text) | said if text.startswith("{") else said or None


def estimates(path: Path, windows: dict[str, Window]) -> dict[str, Any]:
    with path.open() as file:
        rows = list(csv.DictReader(file))
    return {name: _summary(rows, window) for name, window in windows.items()}


def _summary(rows: list[dict[str, str]], window: Window) -> dict[str, Any]:
    """Counts and means: `misled` is the share of all rows whose interval leaves the truth out."""
    rows = [row for row in rows if window.from_s < float(row["time_s"]) <= window.to_s]
    estimated = [row for row in rows if row["status"] == "estimated"]
    names = ("low", "preload_percent", "high")
    numbers = [[float(row[name]) for name in names] for row in estimated]
    of = max(len(rows), 1)
    answer: dict[str, Any] = {
        "rows": len(rows),
        "estimated": len(estimated) / of,
        "statuses": sorted({row["status"] for row in rows}),
        "reasons": sorted({code for row in rows for code in row["reasons"].split()}),
        "numbers_without_status": sum(
            bool(row["preload_percent"]) for row in rows if row["status"] != "estimated"
        ),
    }
    if window.truth_percent is not None:
        truth = window.truth_percent
        answer["misled"] = sum(not low <= truth <= high for low, _, high in numbers) / of
    if numbers:
        answer["preload_percent"] = sum(each[1] for each in numbers) / len(numbers)
        answer["last"] = dict(zip(names, numbers[-1], strict=True))
    return answer


def asked(case: Case) -> Outcome:
    """Ask the HTTP interface of a service whose axis X is well."""
    assert case.request is not None
    scene = Scene()
    scene.hear_all()

    async def get(path: str) -> httpx.Response:
        async with client_of(scene.app, raise_app_exceptions=False) as client:
            return await client.get(path)

    response = asyncio.run(get(case.request))
    body = response.json() if "json" in response.headers["content-type"] else response.text
    head = {"status": response.status_code, "type": response.headers["content-type"]}
    return Outcome(0, "", head | {"body": body})
