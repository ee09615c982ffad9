"""Prints the software bill of materials (CycloneDX 1.6, JSON): what the service is made of.

`.venv/bin/python deploy/sbom.py >sbom.json`. Names, versions and hashes are those of
both locks, licences those that the installed packages state (`deploy/setup.sh dev` installs all).
What only tests and development need has the scope `excluded`; what an extra needs, `optional`.
"""

import json
import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parent.parent
PRODUCT = "edge-service"
LOCKS = ("deploy/requirements.lock", "deploy/requirements-dev.lock")
EXTRAS = ("mcap", "opcua", "mqtt", "cluster")
_PACKAGE = re.compile(r"(?m)^([a-z0-9._-]+)==(\S+) \\\n((?: +--hash=.+\n)+)((?: +#.*\n?)*)")
_UPLOT = ROOT / "edge_service" / "http_api" / "static" / "uplot.js"


@dataclass(frozen=True, slots=True)
class Package:
    """One package of the lock, with the packages that ask for it."""

    name: str
    version: str
    hashes: tuple[str, ...]
    parents: tuple[str, ...]

    @property
    def purl(self) -> str:
        """Its address in the words of package-url."""
        return f"pkg:pypi/{self.name}@{self.version}"


def packages(lock: str) -> Iterator[Package]:
    """Packages of a lock file."""
    for name, version, hashes, comments in _PACKAGE.findall(lock):
        parents = tuple(re.findall(r"(?m)^ +# +(?:via +)?([a-z0-9._-]+)", comments))
        yield Package(name, version, tuple(re.findall(r"sha256:(\w+)", hashes)), parents)


def needed_by(roots: Iterable[str], known: Iterable[Package]) -> set[str]:
    """Names of the packages that roots need, the roots included."""
    needed = {re.split(r"[<>=\[;]", root)[0].strip() for root in roots}
    while more := {each.name for each in known if needed & set(each.parents)} - needed:
        needed |= more
    return needed


def licence(name: str) -> list[dict[str, Any]]:
    """Licence that an installed package states; empty if it is not installed or says none."""
    try:
        said = metadata(name)
    except PackageNotFoundError:
        return []
    if expression := said.get("License-Expression"):
        return [{"expression": expression}]
    classifiers = [
        each.rpartition(" :: ")[2]
        for each in said.get_all("Classifier", ())
        if each.startswith("License :: ") and not each.endswith("OSI Approved")
    ]
    stated = classifiers or (said.get("License") or "").splitlines()[:1]
    return [{"license": {"name": each}} for each in stated if each]


def component(package: Package, scope: str) -> dict[str, Any]:
    """One entry of the bill."""
    return {
        "type": "library",
        "bom-ref": package.purl,
        "name": package.name,
        "version": package.version,
        "scope": scope,
        "purl": package.purl,
        "licenses": licence(package.name),
        "hashes": [{"alg": "SHA-256", "content": each} for each in package.hashes],
    }


def vendored() -> dict[str, Any]:
    """The one library that the page brings along."""
    found = re.search(r"uPlot.*?v(\d+\.\d+\.\d+)", _UPLOT.read_text("utf-8"), re.DOTALL)
    assert found
    purl = f"pkg:npm/uplot@{found[1]}"
    stated = {"licenses": [{"license": {"id": "MIT"}}], "scope": "required", "purl": purl}
    named = {"type": "library", "bom-ref": purl, "name": "uplot", "version": found[1]}
    return named | stated


def bill() -> dict[str, Any]:
    """The bill of materials of this checkout."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    known = [each for lock in LOCKS for each in packages((ROOT / lock).read_text("utf-8"))]
    extras = [each for extra in EXTRAS for each in project["optional-dependencies"][extra]]
    required = needed_by(project["dependencies"], known)
    optional = needed_by(extras, known)

    def scope(name: str) -> str:
        return "required" if name in required else "optional" if name in optional else "excluded"

    product = f"pkg:pypi/{PRODUCT}@{project['version']}"
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": product,
                "name": PRODUCT,
                "version": project["version"],
                "purl": product,
                "licenses": [{"expression": project["license"]}],
            }
        },
        "components": [*(component(each, scope(each.name)) for each in known), vendored()],
        "dependencies": [
            {
                "ref": product if name == PRODUCT else purl,
                "dependsOn": [each.purl for each in known if name in each.parents],
            }
            for name, purl in [(PRODUCT, product), *((each.name, each.purl) for each in known)]
        ],
    }


if __name__ == "__main__":
    json.dump(bill(), sys.stdout, indent=1)
    sys.stdout.write("\n")
