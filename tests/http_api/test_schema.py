"""The running service against its own schema, by a tester that nobody here wrote."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import httpx
import pytest

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
