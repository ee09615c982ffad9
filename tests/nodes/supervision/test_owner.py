"""Nothing in the service works without an owner: tasks and threads begin in one place."""

import ast
from pathlib import Path

import pytest

from ...documents import ROOT

BEGIN = {
    "create_task",
    "ensure_future",
    "TaskGroup",
    "gather",
    "to_thread",
    "run_in_executor",
    "run_coroutine_threadsafe",
    "Thread",
    "ThreadPoolExecutor",
    "ProcessPoolExecutor",
    "Timer",
}
"""Names that begin a task or a thread."""
OWNER = "nodes/supervision/"
WAITED_FOR = {
    "bus/session.py": {"to_thread"},
    "nodes/wiring/event_dispatcher.py": {"ensure_future"},
    "nodes/wiring/history_queries.py": {"create_task"},
}
"""Begun and waited for within a supervised task or a request."""


def begun(text: str) -> set[str]:
    """Calls that begin a task or a thread."""
    called = (node.func for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    names = {each.attr if isinstance(each, ast.Attribute) else ast.unparse(each) for each in called}
    return names & BEGIN


def modules() -> list[Path]:
    house = ROOT / "edge_service"
    return [path for room in ("nodes", "bus") for path in sorted((house / room).rglob("*.py"))]


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.stem)
def test_no_node_begins_a_task_without_an_owner(path: Path) -> None:
    place = path.relative_to(ROOT / "edge_service").as_posix()
    if not place.startswith(OWNER):
        assert begun(path.read_text("utf-8")) <= WAITED_FOR.get(place, set())


def test_no_exception_is_out_of_date() -> None:
    for place, names in WAITED_FOR.items():
        assert begun((ROOT / "edge_service" / place).read_text("utf-8")) == names


@pytest.mark.parametrize(
    "line",
    ["asyncio.create_task(work())", "create_task(work())", "async with asyncio.TaskGroup(): pass"],
)
def test_a_task_without_an_owner_is_found(line: str) -> None:
    assert begun(f"async def run():\n    {line}\n")
