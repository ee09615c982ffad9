"""The house keeps its layout, and what a user can set or ask is documented."""

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from drivers.base import driver_names, load_driver
from edge_service.config import EdgeConfig, load_config
from edge_service.estimate.mixture import state
from edge_service.estimate.mixture.model import CLEARANCE_M
from edge_service.estimate.mixture.state import ASSUMED
from edge_service.estimate.mixture.step import FORCED, OUTLIER
from edge_service.messages.topics import TOPICS
from edge_service.models.effects.registry import effect_names, get_effect
from edge_service.outputs.base import load_output
from edge_service.plugins import plugins

from .documents import ROOT, document, documents
from .programs import ran

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
TOP_LEVEL = {"pyproject.toml", "edge_service", "drivers", "tests", "deploy", "README.md"}
TOP_LEVEL |= {"LICENSE"}


def test_the_top_level_is_the_one_agreed() -> None:
    listed = ran("git", "ls-files", "--cached", "--others", "--exclude-standard", folder=ROOT)
    if listed.returncode != 0:
        pytest.skip("no git checkout")
    names = {line.split("/")[0] for line in listed.stdout.splitlines()}
    assert {name for name in names if not name.startswith(".")} == TOP_LEVEL


def test_every_room_has_its_place_in_the_rules() -> None:
    layers = PROJECT["tool"]["importlinter"]["contracts"][0]["layers"]
    placed = {name.strip() for layer in layers for name in layer.split("|")}
    rooms = {f"edge_service.{path.parent.name}" for path in ROOT.glob("edge_service/*/__init__.py")}
    assert rooms <= placed


def test_no_rule_has_an_exception() -> None:
    for contract in PROJECT["tool"]["importlinter"]["contracts"]:
        assert not contract.get("ignore_imports")


def modules() -> dict[str, Path]:
    found = {}
    for room in ("edge_service", "drivers", "tests"):
        for path in (ROOT / room).rglob("*.py"):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def imported_names(name: str, path: Path) -> Iterator[str]:
    """All that a module imports, wherever in it: modules, and names within them."""
    package = name.split(".") if path.stem == "__init__" else name.split(".")[:-1]
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*start, *([node.module] if node.module else [])])
            yield from (f"{source}.{each.name}" for each in node.names)


@cache
def graph_of_the_checkout() -> Mapping[str, set[str]]:
    paths, graph = modules(), dict[str, set[str]]()
    for name, path in paths.items():
        used = imported_names(name, path)
        graph[name] = {each if each in paths else each.rpartition(".")[0] for each in used}
        graph[name] = (graph[name] & set(paths)) - {name}
    return graph


def test_no_modules_import_each_other_in_a_circle() -> None:
    try:
        TopologicalSorter(graph_of_the_checkout()).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def room_of(module: str) -> str:
    """Room of a module: a package of the service, or the drivers."""
    first, *rest = module.split(".")
    return rest[0] if first == "edge_service" and rest else first


def test_the_house_table_states_what_each_room_may_know() -> None:
    """Modules beside the rooms (configuration, exit status, files) may be known by any."""
    rows = re.findall(r"(?m)^\| \[(\w+)\]\(.+ \| (.+) \|$", document("edge_service/README.md"))
    known = {room: set(re.findall(r"\w+", cell)) for room, cell in rows}
    packages = {path.parent.name for path in ROOT.glob("edge_service/*/__init__.py")}
    assert set(known) == {*packages, "drivers"}
    every = set(known)
    known |= {"cli": every, "offline": every - {"cli"}}
    for module, used in graph_of_the_checkout().items():
        room = room_of(module)
        if room in known:
            assert {room_of(each) for each in used} & every <= known[room] | {room}, module


def test_the_product_names_its_tests_nowhere() -> None:
    """The project file names the developers' benchmarks; a module of the product names none."""
    named = re.compile(r"[\"'/]tests\b|\b(from|import) tests\b")
    files = [*ROOT.glob("edge_service/**/*.py"), *ROOT.glob("drivers/**/*.py")]
    assert [path for path in files if named.search(path.read_text("utf-8"))] == []


MOST_MODULES = 15
LARGE_FOLDERS = {
    "edge_service/models/effects/library",  # a file per effect
    "edge_service/messages",
    "edge_service/http_api",
    "edge_service/offline",  # a module a command
    "edge_service",  # what rooms share: clock, files, threads, exit status
}
"""Folders of the product that have more modules."""


def test_no_folder_of_the_product_becomes_too_large_to_be_looked_over() -> None:
    for folder in {path.parent for path in modules().values() if path.stem != "__init__"}:
        place = folder.relative_to(ROOT).as_posix()
        if not place.startswith("tests") and place not in LARGE_FOLDERS:
            count = sum(path.stem != "__init__" for path in folder.glob("*.py"))
            assert count <= MOST_MODULES, place


MOST_LINES = {
    "bus": 812,
    "checks": 3483,
    "cli": 1333,
    "config": 583,
    "diagnose": 4950,
    "downsample": 1183,
    "drivers": 3667,
    "estimate": 5159,
    "fingerprint": 2769,
    "health": 4520,
    "http_api": 2410,
    "messages": 2024,
    "models": 5653,
    "nodes": 2892,
    "offline": 5639,
    "outputs": 1782,
    "recordings": 3264,
    "regression": 1000,
    "beside the rooms": 757,
    "tests": 44953,
}
"""Lines of Python that a room has at most. Numbers only fall."""
MOST_FILES = 366
"""Modules of the product."""


def python_of(room: str) -> list[Path]:
    """Python files of a room, of the tests, or of what lies beside the rooms."""
    if room == "beside the rooms":
        return list((ROOT / "edge_service").glob("*.py"))
    return list((ROOT if room in TOP_LEVEL else ROOT / "edge_service").joinpath(room).rglob("*.py"))


def test_every_room_has_a_size() -> None:
    rooms = {path.parent.name for path in ROOT.glob("edge_service/*/__init__.py")}
    assert set(MOST_LINES) == rooms | {"drivers", "tests", "beside the rooms"}


@pytest.mark.parametrize("room", MOST_LINES)
def test_no_room_grows(room: str) -> None:
    size = sum(len(path.read_text("utf-8").splitlines()) for path in python_of(room))
    assert size <= MOST_LINES[room]


def test_the_product_has_no_more_files() -> None:
    rooms = [room for room in MOST_LINES if room != "tests"]
    assert sum(len(python_of(room)) for room in rooms) <= MOST_FILES


def keys_of(model: type[BaseModel]) -> set[str]:
    keys = set()
    for name, field in model.model_fields.items():
        nested = [
            each
            for each in (field.annotation, *get_args(field.annotation))
            if isinstance(each, type) and issubclass(each, BaseModel)
        ]
        keys |= {key for each in nested for key in keys_of(each)} | {name}
    return keys


def test_every_key_of_the_configuration_stands_in_the_example() -> None:
    text = (ROOT / "deploy" / "edge.toml").read_text()
    for key in keys_of(EdgeConfig):
        assert re.search(rf"\b{key}\b", text), key
    load_config(ROOT / "deploy" / "edge.toml")


@pytest.mark.parametrize("name", driver_names())
def test_every_driver_has_an_example_with_every_key(name: str) -> None:
    path = ROOT / "deploy" / "drivers" / f"{name}.toml"
    config = load_config(path)
    model = load_driver(name).config_model
    model.model_validate(config.axes[0].settings)
    text = path.read_text()
    for key, field in model.model_fields.items():
        shown = re.search(rf"^(# )?{key} = (.+?)\s+#", text, re.MULTILINE)
        assert shown, key
        if not shown.group(1) and not field.is_required():
            assert tomllib.loads(f"value = {shown.group(2)}")["value"] == field.default


@pytest.mark.parametrize(
    "name", [name for name in plugins("edge_service.outputs") if name != "metrics"]
)
def test_every_output_has_an_example_with_every_key(name: str) -> None:
    path = ROOT / "deploy" / "outputs" / f"{name}.toml"
    model = load_output(name).config_model
    model.model_validate(load_config(path).outputs[name])
    for key in model.model_fields.keys() - {"kind", "password"}:
        assert re.search(rf"^(# )?{key} = (.+?)\s+#", path.read_text(), re.MULTILINE), key


def test_every_topic_stands_in_the_readme_with_its_times() -> None:
    lines = document("edge_service/messages/README.md").splitlines()
    for topic in TOPICS.values():
        row = next(line for line in lines if line.startswith(f"| `{topic.name}`"))
        assert topic.schema in row
        assert topic.encoding in row
        if topic.rate_hz:
            assert f"{topic.rate_hz:g} Hz" in row
            assert f"{topic.stale_after_s:g} s" in row


def test_every_dependency_is_explained_in_the_readme() -> None:
    extras = dict(PROJECT["project"]["optional-dependencies"])
    tools = "".join(re.findall(r"(?m)^\| .+", document("tests/README.md")))
    house = document("edge_service/README.md")
    used = [*PROJECT["project"]["dependencies"], *extras["mcap"], *extras["opcua"], *extras["mqtt"]]
    for requirement in {*used, *extras["dev"]}:
        name = re.split(r"[<>=\[]", requirement)[0]
        assert f"| {name} |" in house or (requirement not in used and name in tools), name


def test_every_state_and_hypothesis_of_the_estimator_stands_in_the_readme() -> None:
    counts = {"TORQUE_STATES", "MAP_STATES", "STRETCH_STATES", "HYPOTHESES", "MOMENTS"}
    moments = {"SINCE_SPAWN_S", "STOPPED_S", "LEARNING", "SURPRISE", "FASTEST_RAD_S", "RAPID_S"}
    moments |= {"INERTIA_ERROR", "INERTIA_TORQUE", *(n for n in vars(state) if "FORCED_S" in n)}
    names = {name for name, value in vars(state).items() if name.isupper() and type(value) is int}
    text = document("edge_service/estimate/README.md")
    for name in names - counts - moments:
        assert f"`{name}`" in text, name


def test_the_readme_tells_what_the_estimator_assumes() -> None:
    said, text = ASSUMED, " ".join(document("edge_service/estimate/README.md").split())
    shares = f"by {said.together:.0%} all alike, {said.apart:.0%} each apart"
    assert shares.replace("%", " %") in text
    assert f"Ornstein-Uhlenbeck, {said.friction_s:g} s" in text
    assert f"a share of {said.evidence:g} only".replace("0.", ".") in text
    assert f"differs by {100 * said.axial:.2g} % of the Coulomb friction" in text
    assert f"(and {state.MOST_SHARE - 1.0:.0%} for what heat does)".replace("%", " %") in text
    small = said.force * said.force_small
    force = f"process forces of {said.force:g} of the dynamic load rating, and as many of {small:g}"
    assert force.replace("0.", ".") in text
    assert f"a force is above {FORCED:g} corrects".replace("0.", ".") in text
    assert f"an innovation squared above {OUTLIER:g}" in text
    assert f"No phase says more than {said.most_nats:g} nats" in text
    assert f"(assumed: {said.hazard:.0e} per second)".replace("-0", "-") in text
    assert "loosenings ten times as likely" in text and said.loosens == 10.0
    assert f"begin with {said.stop_hazard:.0e} per second of it (assumed".replace("-0", "-") in text
    assert f"clearance of {CLEARANCE_M * 1e6:g} um" in text
    assert f"to an assumed {said.looseness * 100:g} %".replace("0.", ".") in text
    assert f"{said.uneven_share:.0%} of the growth (assumed)".replace("%", " %") in text
    assert f"twist of the screw: {said.twist * 100:g} +- {said.twist * 100:g} %" in text
    assert f"by {said.torque_scale * 100:g} +- {said.torque_scale * 100:g} % (magnets" in text
    assert f"how much torque is read, too, by {said.scale * 100:g} % (assumed)" in text
    assert f"commissioned one to {said.payload * 100:g} %".replace("0.", ".") in text


LOCKS = ("requirements.lock", "requirements-dev.lock")


def pinned_in(lock: str) -> list[str]:
    """Packages that a lock pins, in its order."""
    text = (ROOT / "deploy" / lock).read_text()
    pinned = re.findall(r"^([a-z0-9_.\-]+)==[^\s]+ \\\n    --hash=sha256:", text, re.MULTILINE)
    assert pinned == re.findall(r"^[a-z0-9_.\-]+", text, re.MULTILINE)
    return pinned


def test_the_locks_pin_every_package_once_with_a_hash() -> None:
    pinned = [name for lock in LOCKS for name in pinned_in(lock)]
    assert len(set(pinned)) == len(pinned)
    for requirement in PROJECT["project"]["optional-dependencies"]["dev"]:
        assert re.split(r"[<>=\[]", requirement)[0] in pinned


def test_what_tests_look_for_is_locked_and_every_lock_is_installed() -> None:
    locks = [path.name for path in (ROOT / "deploy").glob("requirements*.lock")]
    scripts = document("deploy/setup.sh") + document("deploy/check.sh")
    assert [each for each in locks if f"-r deploy/{each}" not in scripts] == []
    tests = "".join(path.read_text() for path in ROOT.glob("tests/**/*.py"))
    looked_for = re.findall(r'(?:importorskip|find_spec)\(\s*"(\w+)', tests)
    pinned = {name for lock in locks for name in pinned_in(lock)}
    assert {each.replace("_", "-") for each in looked_for} - pinned == set()


def test_what_runs_the_service_is_locked_apart_from_what_tests_it() -> None:
    running, extras = pinned_in(LOCKS[0]), PROJECT["project"]["optional-dependencies"]
    wanted = [*PROJECT["project"]["dependencies"]]
    left = {"dev", "cluster"}  # a cluster is for few, and 43 MB
    wanted += [each for name, group in extras.items() if name not in left for each in group]
    names = {re.split(r"[<>=\[]", requirement)[0] for requirement in wanted}
    assert names <= set(running)
    tools = {re.split(r"[<>=\[]", requirement)[0] for requirement in extras["dev"]} - names
    assert tools <= set(pinned_in(LOCKS[1]))


def test_the_project_speaks_of_itself_alone() -> None:
    code = [path for room in ("edge_service", "drivers") for path in ROOT.glob(f"{room}/**/*.py")]
    for path in [*code, *(ROOT / each for each in documents())]:
        assert not re.search(r"/(?:work|root|tmp)/", path.read_text()), path


def test_every_effect_stands_in_the_readme_with_its_parameters() -> None:
    lines = document("edge_service/models/README.md").splitlines()
    for name in effect_names():
        row = next(line for line in lines if line.startswith(f"| `{name}` |"))
        for parameter in get_effect(name).parameters:
            assert f"`{parameter.name}`" in row


OTHER_MEANINGS = {
    "edge_service/estimate/mixture/posterior.py": {"preload_loss"},  # a fault's probability
    "edge_service/health/alarms.py": {"preload_loss"},
    "edge_service/fingerprint/fingerprint.py": {"backlash"},  # a section of the fingerprint
    "edge_service/offline/report/fingerprint_page.py": {"backlash"},
    "edge_service/fingerprint/response/two_mass_fit.py": {"delay"},  # an unknown of the fit
    "edge_service/models/motions/registry.py": {"warmup"},  # a motion
    "edge_service/offline/simulate.py": {"external_force"},  # a measured one, of a file
    "edge_service/offline/reproduce/puzzle.py": {
        "stribeck",
        "warmup",
        "compliance",
    },  # as it states
}
"""Files that name an effect: mostly a thing of the same name."""


def named_effects(tree: ast.AST) -> set[str]:
    """Effects that a module names in a text of its own, alone or as NAME:key=value."""
    texts = {
        node.value.split(":")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    return texts & set(effect_names())


def test_an_effect_is_named_in_its_own_file_only() -> None:
    """Anything that others need to know of an effect is a property of it."""
    library = ROOT / "edge_service" / "models" / "effects" / "library"
    for path in [*ROOT.glob("edge_service/**/*.py"), *ROOT.glob("drivers/**/*.py")]:
        known = OTHER_MEANINGS.get(str(path.relative_to(ROOT)), set())
        if path.parent != library:
            assert named_effects(tree_of(path)) <= known, path


def test_the_scripts_import_what_is_there() -> None:
    """A module that moves takes the scripts of `deploy/` with it."""
    scripts = "\n".join(path.read_text("utf-8") for path in ROOT.glob("deploy/*.sh"))
    named = re.findall(r"from (edge_service[\w.]*) import (\w+)", scripts)
    assert named
    for module, name in named:
        assert hasattr(importlib.import_module(module), name)


def folder_graph(graph: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Folders of a room and those beside them that they use; modules above both are of neither."""
    folders: dict[str, set[str]] = {}
    for name, used in graph.items():
        for other in used:
            mine, its = name.split("."), other.split(".")
            shared = next(k for k, (a, b) in enumerate(zip(mine, its, strict=False)) if a != b)
            if shared >= 2 and len(mine) > shared + 1 and len(its) > shared + 1:
                user = ".".join(mine[: shared + 1])
                folders.setdefault(user, set()).add(".".join(its[: shared + 1]))
    return folders


def test_no_folders_of_a_room_use_each_other_in_a_circle() -> None:
    """Stages have an order: what comes first knows nothing of what comes after."""
    product = {name: path for name, path in modules().items() if not name.startswith("tests")}
    packages = {name for name, path in product.items() if path.stem == "__init__"}
    graph = {
        name: {each for each in used if each not in packages}
        for name, used in graph_of_the_checkout().items()
        if name in product and name not in packages
    }
    try:
        TopologicalSorter(folder_graph(graph)).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


ASKING = re.compile(r"((tell )?whether|true|what|how|which|when|why|who|whose|where)\b", re.I)


def questions(tree: ast.AST) -> list[str]:
    """First lines of docstrings, also of constants and attributes, that begin as a question."""
    texts = [
        node.value.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    ]
    return [text.splitlines()[0] for text in texts if ASKING.match(text)]


def test_no_docstring_begins_as_a_question() -> None:
    found = {
        path.relative_to(ROOT).as_posix(): asked
        for path in modules().values()
        if not path.is_relative_to(ROOT / "tests")
        if (asked := questions(tree_of(path)))
    }
    assert found == {}
