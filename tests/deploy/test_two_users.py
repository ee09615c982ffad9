"""Reach of another user of the same machine: the table of deploy/SECURITY.md, with two uids."""

import json
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from edge_service.config import load_config
from edge_service.health.store.store import FILE_NAME, Store
from edge_service.health.store.tokens import Tokens
from edge_service.http_api.recordings import Recordings
from edge_service.nodes.http_rights import check_access

from ..documents import ROOT

OTHER = 65_534
pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="only root can be two users")


def as_another(work: Callable[[], object]) -> object:
    """JSON of what another user's process finds."""
    "a.b".encode("idna")  # another user may not be able to load modules
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.setgroups([])
            os.setgid(OTHER)
            os.setuid(OTHER)
            os.write(writing, json.dumps(work()).encode())
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as said:
        found = said.read()
    os.waitpid(child, 0)
    return json.loads(found)


@pytest.fixture
def folder() -> Iterator[Path]:
    """A folder that everybody may enter, as /etc and /var/lib are."""
    with tempfile.TemporaryDirectory() as name:
        Path(name).chmod(0o755)
        yield Path(name)


def refusal(path: Path) -> str:
    try:
        list(path.iterdir()) if path.is_dir() else path.read_bytes()
    except OSError as error:
        return type(error).__name__
    return "readable"


async def test_files_of_the_service_are_its_own(folder: Path) -> None:
    state = folder / "state"
    store = Store(state / FILE_NAME)
    Tokens(store).add("Kim", "operator", 1)
    kept = Recordings(state / "recordings", 1 << 20)

    async def content():
        yield b"time_s\n0\n"

    await kept.receive("a.csv", content())
    (folder / "mqtt.password").write_text("secret")
    (folder / "mqtt.password").chmod(0o600)
    store.close()
    paths = [state, state / FILE_NAME, kept.path("a.csv"), folder / "mqtt.password"]
    own = Path(f"/proc/{os.getpid()}/environ")
    found = as_another(lambda: [refusal(path) for path in [*paths, own]])
    assert found == ["PermissionError"] * 5
    (folder / "edge.toml").write_text(f'[store]\nfolder = "{state}"\n')
    config = load_config(folder / "edge.toml")
    assert "no TLS, tokens cannot be read" in str(as_another(lambda: check_access(config)))


MADE_ALONE = {"mkdtemp", "TemporaryDirectory", "TemporaryFile"}
"""Names in `tempfile` that make a file or folder which nobody can have made before."""
UNSAFE = {"pickle", "marshal", "shelve", "dill", "cloudpickle", "joblib"}


def test_nothing_is_read_from_a_place_or_a_scheduler_that_any_user_can_make() -> None:
    shared, schedulers = [], []
    for path in [*ROOT.glob("edge_service/**/*.py"), *ROOT.glob("drivers/**/*.py")]:
        text = path.read_text("utf-8")
        used = {*re.findall(r"tempfile\.(\w+)", text)} - MADE_ALONE
        used |= UNSAFE & {*re.findall(r"(?m)^\s*(?:import|from) (\w+)", text)}
        used |= {*re.findall(r"[\"'](?:/var)?/(?:tmp|dev/shm)\b", text)}
        shared += [(path.name, sorted(used))] if used else []
        schedulers += [path.name] if re.search(r"LocalCluster|[\"']distributed[\"']", text) else []
    assert (shared, schedulers) == ([], ["batch.py"])  # which wants TLS, or --insecure
