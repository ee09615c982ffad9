"""The running service against its own schema, by a tester that nobody here wrote."""

import shutil
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

SCHEMATHESIS = shutil.which("schemathesis")
LONGEST_S = 40


@pytest.mark.slow
@pytest.mark.skipif(SCHEMATHESIS is None, reason="schemathesis is not installed (pipx install)")
def test_every_route_keeps_what_its_schema_says(tmp_path: Path) -> None:
    """All routes but the live stream, which has no end.

    Not checked: that every request the schema allows is taken. No schema says that `from` lies
    before `to`, or that a comparison needs two recordings.
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
            assert httpx.get(f"{address}openapi.json").status_code == 200
            said = _examined(f"{address}openapi.json", tmp_path)
        finally:
            service.terminate()
    assert said.returncode == 0, said.stdout[-4000:]


def _examined(schema: str, folder: Path) -> "subprocess.CompletedProcess[str]":
    options = ["--max-time", str(LONGEST_S), "--max-examples", "8", "--seed", "1", "--no-color"]
    options += ["--exclude-path", "/api/v1/events", "--request-timeout", "10"]
    options += ["--exclude-checks", "positive_data_acceptance"]
    return subprocess.run(
        [str(SCHEMATHESIS), "run", schema, *options],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=3 * LONGEST_S,
    )
