"""The running service against its own schema, and the digests of its configuration."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest

from edge_service.config import load_config

from ..documents import ROOT

LONGEST_S = 30
MISSING = find_spec("schemathesis") is None and "EDGE_SERVICE_CHECK" not in os.environ
STREAM = "/api/v1/events"
REPORT = "report.json"


@pytest.mark.slow
@pytest.mark.skipif(MISSING, reason="schemathesis is not installed; deploy/check.sh does it")
def test_every_route_keeps_what_its_schema_says(tmp_path: Path) -> None:
    """All routes but the live stream, which has no end.

    Not checked: that every request the schema allows is taken. No schema says that `from` lies
    before `to`, or that a comparison needs two recordings. A fresh service has no jobs and no
    dead letters: their routes answer mostly that there is none.
    """
    command = [sys.executable, "-m", "edge_service", "run", "--port", "0"]
    command += ["--bus", "tcp/127.0.0.1:0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=tmp_path, text=True
    ) as service:
        try:
            assert service.stdout is not None
            line = next(each for each in service.stdout if "http://" in each)
            address = line[line.index("http://") :].split()[0]
            assert httpx.get(f"{address}openapi.json", timeout=120.0).status_code == 200
            said = _examined(f"{address}openapi.json", tmp_path)
        finally:
            service.terminate()
    assert said.returncode == 0, said.stdout[-4000:] + said.stderr[-4000:]
    routes = json.loads((tmp_path / REPORT).read_text())["operations"]
    assert routes["tested"] == routes["total"] - 1, routes


def _examined(schema: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    options = ["--max-time", str(LONGEST_S), "--max-examples", "8", "--seed", "1", "--no-color"]
    options += ["--exclude-path", STREAM, "--request-timeout", "30"]
    options += ["--exclude-checks", "positive_data_acceptance"]
    options += ["--report", "json", "--report-json-path", REPORT]
    return subprocess.run(
        [sys.executable, "-m", "schemathesis.cli", "run", schema, *options],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=3 * LONGEST_S,
    )


CONFIG = '[service]\nmachine = "mill"\n[[axes]]\nname = "X"\nmachine = "machines/x.toml"\n'


def installed(folder: Path, name: str = "edge.toml") -> Path:
    """A configuration and its machine file."""
    (folder / "machines").mkdir(parents=True)
    (folder / "machines/x.toml").write_text((ROOT / "deploy" / "machine.toml").read_text())
    (folder / name).write_text(CONFIG)
    return folder / name


def test_equal_files_have_equal_digests_wherever_they_lie(tmp_path: Path) -> None:
    one = load_config(installed(tmp_path / "a"))
    other = load_config(installed(tmp_path / "b", "mill.toml"))
    assert one.digest == other.digest == one.model_copy(update={"axes": ()}).digest
    assert len(one.digest) == 12


@pytest.mark.parametrize("name", ["edge.toml", "machines/x.toml"])
def test_a_changed_file_changes_the_digest(tmp_path: Path, name: str) -> None:
    config = installed(tmp_path)
    before = load_config(config).digest
    with (tmp_path / name).open("a") as file:
        file.write("# changed\n")
    assert load_config(config).digest != before
