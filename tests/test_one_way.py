"""One way for each job: a walk over the product's syntax trees names every second one."""

import ast
import re
from collections.abc import Callable, Iterator

import pytest

from .documents import ROOT

WRITES = re.compile(r"[rwax]b?\+?b?")
PAUSE, COUNT = (
    re.compile(r"(?i)delay|pause|backoff|sleep"),
    re.compile(r"(?i)attempt|tries|failures"),
)
Does = Callable[[ast.AST], bool]


def name_of(node: ast.AST) -> str:
    """Dotted name of what is called; empty for what is no call."""
    return ast.unparse(node.func) if isinstance(node, ast.Call) else ""


def calls(*names: str) -> Does:
    """Calls by one of these names, whatever stands before it."""
    wanted = re.compile(rf"(.*\.)?({'|'.join(names)})", re.DOTALL)
    return lambda node: wanted.fullmatch(name_of(node)) is not None


def opens_to_write(node: ast.AST) -> bool:
    """Call of `open(path, mode)`, `path.open(mode)` or `os.open(path, flags)` that may write."""
    if not isinstance(node, ast.Call) or not calls("open", "fdopen")(node):
        return False
    name = name_of(node)
    if name == "os.open":
        return "O_CREAT" in ast.unparse(node)
    is_method = isinstance(node.func, ast.Attribute) and name not in ("io.open", "os.fdopen")
    given = [*node.args[0 if is_method else 1 :][:1]]
    given += [each.value for each in node.keywords if each.arg == "mode"]
    modes = [str(each.value) for each in given if isinstance(each, ast.Constant)]
    return any(WRITES.fullmatch(each) and each.strip("b") != "r" for each in modes)


def renames(node: ast.AST) -> bool:
    """Call of `path.replace(place)` or `path.rename(place)`; `text.replace` takes two texts."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Attribute):
        return False
    is_of_path = len(node.args) == 1 and not node.keywords
    return node.func.attr in ("replace", "rename") and (
        is_of_path or name_of(node).startswith("os.")
    )


def changes_a_file(node: ast.AST) -> bool:
    """Call that writes, renames or moves a file."""
    written = calls("write_text", "write_bytes", "shutil.move", "copyfile", "copy2")
    return opens_to_write(node) or renames(node) or written(node)


def grows_a_pause(node: ast.AST) -> bool:
    """Power of a count of tries, or a pause that is multiplied."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return COUNT.search(ast.unparse(node.right)) is not None
    grows = isinstance(node, ast.AugAssign) and isinstance(node.op, ast.Mult)
    return grows and PAUSE.search(ast.unparse(node.target)) is not None


WAYS: dict[str, tuple[Does, str]] = {
    "change a file": (changes_a_file, "edge_service/atomic.py"),
    "begin a thread": (
        calls(
            "Thread",
            "Timer",
            "ThreadPoolExecutor",
            "to_thread",
            "run_in_executor",
            "run_in_threadpool",
        ),
        "edge_service/threads.py",
    ),
    "start a command": (
        calls(r"create_subprocess_\w+", "Popen", r"subprocess\.\w+", r"os\.(fork|system|exec\w+)"),
        "edge_service/process.py",
    ),
    "share work among processes": (
        calls("ProcessPoolExecutor", r"multiprocessing\.\w+"),
        "edge_service/offline/batch.py",
    ),
    "open a database": (calls(r"sqlite3\.connect"), "edge_service/health/store/store.py"),
    "pause longer each time": (grows_a_pause, "edge_service/retry.py"),
}
"""Job -> what does it, and the one module that may."""


def found(does: Does, tree: ast.AST) -> Iterator[str]:
    """Places of a tree at which something is done."""
    for node in ast.walk(tree):
        if does(node):
            yield f"{getattr(node, 'lineno', 0)}: {ast.unparse(node)[:80]}"


@pytest.mark.parametrize("job", WAYS)
def test_a_job_has_one_home(job: str) -> None:
    does, home = WAYS[job]
    paths = [path for room in ("edge_service", "drivers") for path in (ROOT / room).rglob("*.py")]
    places = {path.relative_to(ROOT).as_posix(): path for path in sorted(paths)}
    second = [
        f"{name}:{place}"
        for name, path in places.items()
        for place in found(does, ast.parse(path.read_text("utf-8")))
        if name != home
    ]
    assert home in places
    assert second == []


@pytest.mark.parametrize(
    ("job", "line"),
    [
        ("change a file", "open(path, 'w')"),
        ("change a file", "path.open(mode='ab')"),
        ("change a file", "path.open('r+b')"),
        ("change a file", "os.replace(a, b)"),
        ("change a file", "part.rename(path)"),
        ("begin a thread", "await asyncio.to_thread(work)"),
        ("start a command", "subprocess.run(['ls'])"),
        ("share work among processes", "concurrent.futures.ProcessPoolExecutor(2)"),
        ("open a database", "sqlite3.connect(path)"),
        ("pause longer each time", "delay_s *= 2"),
        ("pause longer each time", "first_s * 2.0 ** attempt"),
    ],
)
def test_a_second_way_is_found(job: str, line: str) -> None:
    tree = ast.parse(f"async def work():\n    {line}")
    assert len(list(found(WAYS[job][0], tree))) == 1


@pytest.mark.parametrize("line", ["open(path)", "path.open('rb')", "text.replace('a', 'b')"])
def test_what_only_reads_changes_no_file(line: str) -> None:
    assert not list(found(changes_a_file, ast.parse(line)))
