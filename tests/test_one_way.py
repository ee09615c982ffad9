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
    for node in ast.walk(tree):
        if does(node):
            yield f"{getattr(node, 'lineno', 0)}: {ast.unparse(node)[:80]}"


@pytest.mark.parametrize("job", WAYS)
def test_a_job_has_one_home(job: str) -> None:
    does, home = WAYS[job]
    paths = [path for room in ("edge_service", "drivers") for path in (ROOT / room).rglob("*.py")]
    places = {path.relative_to(ROOT).as_posix(): path for path in sorted(paths)}
    at = {name: [*found(does, ast.parse(path.read_text("utf-8")))] for name, path in places.items()}
    assert at.pop(home) or does is grows_a_pause
    assert {name: lines for name, lines in at.items() if lines} == {}


@pytest.mark.parametrize("line", ["delay_s *= 2", "first_s * 2.0 ** attempt"])
def test_a_pause_that_grows_is_found(line: str) -> None:
    assert len(list(found(grows_a_pause, ast.parse(line)))) == 1
