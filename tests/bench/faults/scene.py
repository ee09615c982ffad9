"""A service in a process of its own for the fault benchmarks: configured, asked, measured."""

import http.client
import json
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import Any

from ..speed.process_meter import ServiceProcess, Usage

START_PATIENCE_S = 120.0
KERNELS = Path(tempfile.gettempdir()) / "edge-service-bench-kernels"
"""Where machine code is kept between benchmarks."""
_LOOK_PERIOD_S = 0.05
_TIMEOUT_S = 10.0
_CHECKOUT = Path(__file__).parents[3]
_TABLES = """\
[bus]
endpoint = "tcp/127.0.0.1:0"
[http]
port = 0
"""
_AXIS = """
[[axes]]
name = "{name}"
machine = "{machine}"
driver = "simulated"
[axes.settings]
scenario = "{scenario}"
seed = {seed}
"""


def configuration(
    axes: Sequence[str] = ("X",),
    *,
    folder: Path | None = None,
    scenario: str = "healthy",
    tables: str = "",
) -> str:
    """Configuration of simulated axes on free ports.

    Args:
        folder: of the history; None keeps nothing.
        tables: further TOML tables.
    """
    history = "" if folder is None else f'[store]\nfolder = "{folder}"\n'
    machine = _CHECKOUT / "deploy" / "commissioned.toml"
    body = [
        _AXIS.format(name=name, machine=machine, scenario=scenario, seed=seed)
        for seed, name in enumerate(axes, 1)
    ]
    return _TABLES + history + tables + "".join(body)


@dataclass(frozen=True, slots=True)
class Answer:
    """Status and body of one HTTP answer."""

    status: int
    body: bytes

    @property
    def json(self) -> Any:
        """The body as JSON values."""
        return json.loads(self.body)


@dataclass(frozen=True, slots=True)
class RunningService:
    """A service that serves its page.

    Attributes:
        errors: the file of its log.
    """

    process: ServiceProcess
    host: str
    port: int
    errors: Path

    @property
    def pid(self) -> int:
        """Number of its process."""
        return self.process.pid

    def ask(
        self,
        path: str,
        method: str = "GET",
        body: Any = None,
        timeout_s: float = _TIMEOUT_S,
    ) -> Answer:
        """Answer to one request; a body is sent as JSON, bytes as they are. Raises OSError."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=timeout_s)
        try:
            content = body if body is None or isinstance(body, bytes) else json.dumps(body)
            headers = {} if body is None else {"content-type": "application/json"}
            connection.request(method, path, content, headers)
            response = connection.getresponse()
            return Answer(response.status, response.read())
        finally:
            connection.close()

    def wait_ready(self, patience_s: float = START_PATIENCE_S) -> float:
        """Wait until every axis has fresh input; the time it took, s. Raises TimeoutError."""
        begun_s = monotonic()
        while monotonic() - begun_s < patience_s:
            if self.is_ready():
                return monotonic() - begun_s
            sleep(_LOOK_PERIOD_S)
        raise TimeoutError(f"not ready within {patience_s:g} s")

    def is_ready(self) -> bool:
        """Tell whether every axis has fresh input; not, where nobody answers."""
        try:
            return self.ask("/readyz", timeout_s=2.0).status == 200
        except (OSError, http.client.HTTPException):
            return False

    def usage(self) -> Usage:
        """Processor time and memory so far."""
        return self.process.usage()

    def descriptors(self) -> int:
        """Number of open files and sockets."""
        return len(list(Path(f"/proc/{self.pid}/fd").iterdir()))

    def has_mapped(self, part: str) -> bool:
        """Tell whether it uses a library whose path has this part."""
        return part in Path(f"/proc/{self.pid}/maps").read_text()

    def threads(self) -> int:
        """Number of its threads."""
        return len(list(Path(f"/proc/{self.pid}/task").iterdir()))


@contextmanager
def running_service(
    config: str, folder: Path, module: str = "edge_service"
) -> Iterator[RunningService]:
    """Serve a configuration from `folder` for as long as the context lasts."""
    path = folder / "edge.toml"
    path.write_text(config, encoding="utf-8")
    with ServiceProcess(["run", str(path)], folder, KERNELS, module) as process:
        host, port = process.wait_for_address(START_PATIENCE_S)
        yield RunningService(process, host, port, folder / "stderr.txt")
