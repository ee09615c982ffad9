"""An output is one file: without it everything else loads, and says what is missing."""

import json
import sys
from pathlib import Path

from edge_service.plugins import plugins
from tests.programs import ran

OWN = {"mqtt": ("mqtt", "sparkplug"), "opcua": ("opcua", "opcua_nodes")}
TABLES = {
    "metrics": "",
    "mqtt": 'url = "mqtt://127.0.0.1:1"',
    "mtconnect": 'endpoint = "tcp://127.0.0.1:0"',
    "notify": 'urls_file = "urls"',
    "opcua": 'endpoint = "opc.tcp://127.0.0.1:0"',
}
CHILD = """
import importlib, json, os, pkgutil, sys
for usual in ("zenoh", "edge_service.http_api.app", "edge_service.nodes.stages"):
    importlib.import_module(usual)
from edge_service.plugins import plugins

class Gone:
    modules = set()
    def find_spec(self, module, path=None, target=None):
        if module in self.modules:
            raise ModuleNotFoundError(module)

def without(name, modules, others, all_of_them):
    Gone.modules = {f"edge_service.outputs.{each}" for each in modules}
    assert not Gone.modules & set(sys.modules)
    sys.meta_path.insert(0, Gone())
    del plugins("edge_service.outputs")[name]
    for room in ("outputs", "nodes", "http_api", "config", "cli"):
        package = importlib.import_module(f"edge_service.{room}")
        for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if found.name not in Gone.modules:
                importlib.import_module(found.name)
    from edge_service.cli.entry import main
    assert (main(["check-config", others]), main(["check-config", all_of_them])) == (0, 2)

failed = []
for case in json.loads(sys.argv[1]):
    if (pid := os.fork()) == 0:
        without(*case)
        os._exit(0)
    if os.waitpid(pid, 0)[1]:
        failed.append(case[0])
sys.exit(str(failed) if failed else 0)
"""


def test_everything_stays_without_one_output(tmp_path: Path) -> None:
    (tmp_path / "urls").write_text("json://127.0.0.1:1/\n")
    (tmp_path / "urls").chmod(0o600)
    assert sorted(TABLES) == list(plugins("edge_service.outputs"))
    machine = Path(__file__).parents[2] / "deploy" / "machine.toml"
    paths = {}
    for name in (*TABLES, None):
        tables = [f"[outputs.{each}]\n{TABLES[each]}\n" for each in TABLES if each != name]
        axis = f'[[axes]]\nname = "X"\nmachine = "{machine}"\ndriver = "simulated"\n'
        paths[name] = tmp_path / f"without_{name}.toml"
        paths[name].write_text("\n".join(tables) + axis)
    cases = [(name, OWN.get(name, (name,)), str(paths[name]), str(paths[None])) for name in TABLES]
    run = ran(sys.executable, "-c", CHILD, json.dumps(cases))
    assert run.returncode == 0, run.stderr
    for name in TABLES:
        assert f"no output '{name}'" in run.stderr
