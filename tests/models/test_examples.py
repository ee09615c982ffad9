"""Examples hold, and every public function of the physics has one and says where it is from."""

import doctest
import inspect
import re
from importlib import import_module
from types import ModuleType

import pytest
from pydantic import TypeAdapter

from edge_service.messages.samples import ColumnMap
from edge_service.models.screw import ball_screw, friction, nut_law, stiffness

from ..documents import ROOT

PHYSICS = (ball_screw, friction, nut_law, stiffness)
WITH_EXAMPLES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in (ROOT / "edge_service").rglob("*.py")
    if ">>>" in path.read_text("utf-8")
)


def public_functions(module: ModuleType) -> dict[str, str]:
    """Docstrings of the functions that a module defines itself, by name."""
    return {
        name: inspect.getdoc(thing) or ""
        for name, thing in vars(module).items()
        if not name.startswith("_")
        and callable(thing)
        and not inspect.isclass(thing)
        and getattr(thing, "__module__", None) == module.__name__
    }


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_hold(name: str) -> None:
    result = doctest.testmod(import_module(name))
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("module", PHYSICS, ids=lambda m: m.__name__)
def test_every_public_function_has_an_example_and_a_source(module: ModuleType) -> None:
    source = re.compile(r"[(-][45]\.3\.\d|Table [4A]\.\d|Figure 5\.\d|Appendix A|Not in the thesis")
    functions = public_functions(module)
    assert {name for name, text in functions.items() if ">>>" not in text} == set()
    assert {name for name, text in functions.items() if not source.search(text)} == set()


def test_a_column_as_earlier_versions_knew_it_keeps_the_machine_what_it_was() -> None:
    """Kept states belong to a machine by its content: keys that are not used must not show."""
    kept = {"column": "u_V", "scale": 1.0, "offset": 0.0}
    adapter = TypeAdapter(ColumnMap)
    assert adapter.dump_python(ColumnMap("u_V"), mode="json") == kept
    assert adapter.dump_python(ColumnMap("a", minus="b"))["minus"] == "b"
