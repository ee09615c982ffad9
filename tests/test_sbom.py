"""The bill of materials says what the lock says."""

import json
import re
import subprocess
import sys
from importlib.metadata import version
from typing import Any

import pytest

from .documents import ROOT, document


@pytest.fixture(scope="module")
def bill() -> dict[str, Any]:
    printed = subprocess.run(
        [sys.executable, str(ROOT / "deploy" / "sbom.py")], capture_output=True, check=True
    )
    return json.loads(printed.stdout)


UNSTATED = {"axe-playwright-python"}
"""Tools of the tests whose metadata state no licence."""


def test_it_holds_the_packages_of_the_lock_with_their_hashes(bill: dict[str, Any]) -> None:
    lock = document("deploy/requirements.lock") + document("deploy/requirements-dev.lock")
    pinned = re.findall(r"(?m)^([a-z0-9._-]+)==(\S+) ", lock)
    found = {each["name"]: each for each in bill["components"]}
    assert [(name, found[name]["version"]) for name, _ in pinned] == pinned
    assert set(found) == {name for name, _ in pinned} | {"uplot"}
    hashes = [each["content"] for part in bill["components"] for each in part.get("hashes", ())]
    assert hashes == re.findall(r"sha256:(\w{64})", lock)


def test_every_part_has_a_licence_and_an_address(bill: dict[str, Any]) -> None:
    for part in bill["components"]:
        assert part["licenses"] or part["name"] in UNSTATED, part["name"]
        assert re.fullmatch(r"pkg:(pypi|npm)/[a-z0-9._-]+@\S+", part["purl"])
    assert len({part["bom-ref"] for part in bill["components"]}) == len(bill["components"])


def test_it_tells_what_runs_from_what_tests_and_extras_need(bill: dict[str, Any]) -> None:
    scopes = {part["name"]: part["scope"] for part in bill["components"]}
    expected = {"numpy": "required", "starlette": "required", "uplot": "required"}
    expected |= {"cffi": "required", "asyncua": "optional", "paho-mqtt": "optional"}
    expected |= {"pytest": "excluded", "ruff": "excluded", "hypothesis": "excluded"}
    assert {name: scopes[name] for name in expected} == expected


def test_who_depends_on_whom_is_known(bill: dict[str, Any]) -> None:
    named = {part["bom-ref"] for part in bill["components"]}
    product = bill["metadata"]["component"]
    assert product["version"] == version("edge-service")
    for each in bill["dependencies"]:
        assert set(each["dependsOn"]) <= named
        assert each["ref"] in named | {product["bom-ref"]}
