"""The plant of simulated machines on one computer: it comes up whole, and nothing is left of it."""

import json
import os
import shutil
import signal
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from tests.documents import ROOT
from tests.nodes.fleet.plants import free_port, until

COMMAND = f'#!/bin/sh\nexec "{sys.executable}" -m edge_service "$@"\n'


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout that is set up, with the command of the one that is tested."""
    (tmp_path / "deploy").mkdir()
    for name in ("plant.sh", "commissioned.toml"):
        shutil.copy(ROOT / "deploy" / name, tmp_path / "deploy" / name)
    (tmp_path / "deploy" / "setup.sh").write_text("")
    command = tmp_path / ".venv" / "bin" / "edge-service"
    command.parent.mkdir(parents=True)
    command.write_text(COMMAND)
    command.chmod(0o755)
    return tmp_path


@pytest.mark.parametrize("number", ["0", "-1", "many", "2x"])
def test_what_is_no_number_of_machines_is_refused(checkout: Path, number: str) -> None:
    line = ["sh", str(checkout / "deploy" / "plant.sh"), number]
    done = subprocess.run(line, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stderr == f"plant: expected a number of machines, not '{number}'\n"


@pytest.mark.slow
@pytest.mark.parametrize("how", ["a terminal", "one signal"])
def test_a_plant_comes_up_and_ends_with_all_that_it_has_started(checkout: Path, how: str) -> None:
    page, router = free_port(), free_port()
    kept = checkout / "kept"
    kept.mkdir()
    given = {"PLANT_PORT": str(router), "PLANT_PAGE_PORT": str(page), "TMPDIR": str(kept)}
    process = subprocess.Popen(
        ["sh", str(checkout / "deploy" / "plant.sh"), "2"],
        env=os.environ | given | {"PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:

        def shows_all() -> bool:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{page}/api/v1/fleet") as answer:
                    fleet = json.load(answer)
            except urllib.error.URLError:
                return False
            return bool(fleet["counts"]["NORMAL"] == fleet["axes"] == 4)

        until(shows_all, 120.0)
        assert len(list(kept.iterdir())) == 1
        if how == "a terminal":
            os.killpg(process.pid, signal.SIGINT)
        else:
            process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=60.0)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    assert process.returncode in (130, 143, -signal.SIGINT)
    assert f"http://127.0.0.1:{page}/" in said
    assert "mill-2" in said
    assert list(kept.iterdir()) == []
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
