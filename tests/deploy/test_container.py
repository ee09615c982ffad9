"""The image's file and the compose file are right, and say what the rest of the project says."""

import json
import re
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from tests.documents import ROOT, document
from tests.programs import ran

DEPLOY = ROOT / "deploy"
RECIPE = document("deploy/Containerfile")
UNIT = document("deploy/edge-service.service")
COMPOSE = DEPLOY / "compose.yml"
HADOLINT = shutil.which("hadolint") or shutil.which(
    "hadolint", path=str(Path(sys.executable).parent)
)


def instructions(name: str) -> list[str]:
    """Arguments of all instructions of a name in the image that is kept, the last one."""
    last = RECIPE.replace("\\\n", " ").split("\nFROM ")[-1]
    return re.findall(rf"^{name} +(.*)$", last, flags=re.M)


@pytest.mark.skipif(HADOLINT is None, reason="hadolint is not installed")
def test_the_linter_finds_nothing() -> None:
    said = ran(str(HADOLINT), "--failure-threshold", "style", DEPLOY / "Containerfile")
    assert (said.stdout, said.returncode) == ("", 0)


def test_what_is_copied_is_there_and_what_the_package_needs_is_copied() -> None:
    copied = [line.split()[:-1] for line in re.findall(r"^COPY (.*)$", RECIPE, flags=re.M)]
    names = {name for line in copied for name in line}
    assert all((ROOT / name).exists() for name in names)
    (need,) = re.findall(r"^ *cp -rL --parents (.*) \"\$work", document("deploy/package.sh"), re.M)
    assert {*need.split(), "deploy"} == names
    packages = tomllib.loads(document("pyproject.toml"))["tool"]["setuptools"]["packages"]["find"]
    assert {each.strip("*") for each in packages["include"]} <= {Path(each).name for each in names}


def test_it_runs_and_serves_as_the_unit_does_and_not_as_root() -> None:
    command = [*json.loads(instructions("ENTRYPOINT")[0]), *json.loads(instructions("CMD")[0])]
    assert f"ExecStart={' '.join(command)}\n" in UNIT
    (state,) = re.findall(r"^StateDirectory=(.*)$", UNIT, flags=re.M)
    (cache,) = re.findall(r"^CacheDirectory=(.*)$", UNIT, flags=re.M)
    (plots,) = re.findall(r"^Environment=(.*)$", UNIT, flags=re.M)
    assert instructions("ENV") == [f"CACHE_DIRECTORY=/var/cache/{cache} {plots}"]
    assert json.loads(instructions("VOLUME")[0]) == [f"/var/lib/{state}", f"/var/cache/{cache}"]
    (user,) = instructions("USER")
    number, group = map(int, user.split(":"))
    assert number > 0 < group
    assert f"--uid {number} --gid {group}" in RECIPE
    http = tomllib.loads(document("deploy/edge.toml"))["http"]
    assert re.findall(r"127\.0\.0\.1:(\d+)/healthz", RECIPE) == [str(http["port"])]


@pytest.fixture(scope="module")
def compose() -> dict[str, Any]:
    """The compose file, as a parser reads it that nobody here wrote."""
    parser = pytest.importorskip("compose_spec")
    read = parser.PyCompose.from_yaml(COMPOSE.read_text("utf-8"))
    read.validate()
    described: dict[str, Any] = read.to_dict()
    return described


def test_every_service_is_bound_to_loopback_and_starts_again(compose: dict[str, Any]) -> None:
    assert set(compose["services"]) == {"edge-service", "prometheus", "grafana"}
    for service in compose["services"].values():
        assert service["cap_drop"] == ["ALL"]
        assert service["security_opt"] == ["no-new-privileges:true"]
        assert (service["restart"], service["network_mode"]) == ("unless-stopped", "host")
        assert "ports" not in service
    services = compose["services"]
    assert services["edge-service"]["read_only"] is True
    assert "--web.listen-address=127.0.0.1:9090" in services["prometheus"]["command"]
    assert services["grafana"]["environment"]["GF_SERVER_HTTP_ADDR"] == "127.0.0.1"


def test_volumes_are_declared_and_files_are_there(compose: dict[str, Any]) -> None:
    declared, named = set(compose["volumes"]), set()
    for service in compose["services"].values():
        for volume in service["volumes"]:
            source = (
                volume.split(":")[0] if isinstance(volume, str) else str(volume.get("source", ""))
            )
            if source.startswith("."):
                assert (DEPLOY / source).is_file(), source
            else:
                named.add(source)
    assert named == declared


def test_grafana_asks_the_prometheus_that_is_there(compose: dict[str, Any]) -> None:
    content = {name: json.loads(each["content"]) for name, each in compose["configs"].items()}
    (source,) = content["grafana_source"]["datasources"]
    assert (source["type"], source["url"]) == ("prometheus", "http://127.0.0.1:9090")
    (provider,) = content["grafana_dashboards"]["providers"]
    folder = provider["options"]["path"]
    mounted = COMPOSE.read_text("utf-8")
    assert f"./grafana.json:{folder}/" in mounted
    dashboard = json.loads((DEPLOY / "grafana.json").read_text())
    (variable,) = (v for v in dashboard["templating"]["list"] if v["type"] == "datasource")
    assert variable["query"] == source["type"]


def test_its_files_are_those_that_the_guide_names() -> None:
    for name in ("deploy/Containerfile", "deploy/compose.yml"):
        assert f"`{name}`" in document("deploy/README.md")
