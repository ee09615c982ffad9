"""A plant in processes of its own: router, fleet nodes and machines, each ended by its id."""

import json
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PATIENCE_S = 60.0


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def until(is_so: Callable[[], bool], patience_s: float = PATIENCE_S) -> float:
    """Wait until something is so; returns for how long, s."""
    began_s = time.monotonic()
    while not is_so():
        assert time.monotonic() - began_s < patience_s, "it has not come to pass in time"
        time.sleep(0.05)  # another process is waited for
    return time.monotonic() - began_s


class Plant:
    """One plant on this computer.

    Args:
        certificates: folder of `edge-service certs`, for TLS; None for plain TCP.
    """

    def __init__(self, folder: Path, certificates: Path | None = None) -> None:
        self.folder, self.certificates = folder, certificates
        self.endpoint = f"{'tls' if certificates else 'tcp'}/127.0.0.1:{free_port()}"
        self.urls: dict[str, str] = {}
        self.processes: dict[str, subprocess.Popen[str]] = {}

    def start(self, name: str, *arguments: str) -> "subprocess.Popen[str]":
        """Start a module of Python; what it logs goes to a file."""
        log = (self.folder / f"{name}.log").open("a")
        process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
        )
        log.close()
        self.processes[name] = process
        return process

    def line(self, name: str) -> str:
        """The next line that a process prints."""
        output = self.processes[name].stdout
        assert output is not None
        return output.readline().strip()

    def router(self) -> None:
        """Start the router."""
        more = ["--certificates", str(self.certificates)] if self.certificates else []
        self.start("router", "edge_service", "plant", "router", "--listen", self.endpoint, *more)
        assert "serving" in self.line("router")

    def access(self, role: str, certificates: Path | None = None) -> str:
        """Keys of `[plant]` for a machine ("plant") or a fleet node ("fleet")."""
        folder = certificates or self.certificates
        lines = [f'endpoint = "{self.endpoint}"']
        if folder:
            lines.append(f'ca_certificate = "{folder / "ca.pem"}"')
            lines.append(f'client_certificate = "{folder / f"{role}.pem"}"')
            lines.append(f'client_key = "{folder / f"{role}.key"}"')
        return "\n".join(lines) + "\n"

    def node(self, name: str, *, keeps: bool = False, certificates: Path | None = None) -> None:
        """Start a fleet node; with certificates of its own it is a stranger."""
        path = self.folder / f"{name}.toml"
        kept = f'[history]\nfolder = "{name}"\n' if keeps else ""
        path.write_text(
            f'[node]\nname = "{name}"\n[plant]\n{self.access("fleet", certificates)}'
            f"[http]\nport = 0\n{kept}"
        )
        self.start(name, "edge_service", "plant", "node", str(path))
        self.urls[name] = self.line(name).partition("serving ")[2].rstrip("/")

    def machines(self, *more: str, name: str = "machines") -> None:
        """Start machines, and wait until all have reported once."""
        self.start(name, "tests.nodes.fleet.machines", self.endpoint, *more)
        assert self.line(name) == "reporting"

    def kill(self, name: str, number: int = signal.SIGKILL) -> None:
        """End a process."""
        process = self.processes.pop(name)
        process.send_signal(number)
        process.wait(PATIENCE_S)
        assert process.stdout is not None
        process.stdout.close()

    def sent(self, name: str = "machines") -> int:
        """End machines; how many reports they have sent."""
        process = self.processes.pop(name)
        process.send_signal(signal.SIGTERM)
        said, _ = process.communicate(timeout=PATIENCE_S)
        return int(json.loads(said.splitlines()[-1])["sent"])

    def ask(self, node: str, path: str = "/api/v1/fleet") -> Any:
        """The JSON of a fleet node."""
        with urllib.request.urlopen(f"{self.urls[node]}{path}", timeout=10.0) as answer:
            return json.load(answer)

    def metric(self, node: str, name: str) -> float:
        """One value of a node's metrics."""
        with urllib.request.urlopen(f"{self.urls[node]}/metrics", timeout=10.0) as answer:
            lines = answer.read().decode().splitlines()
        return float(next(each for each in lines if f'"{name}"' in each).rpartition(" ")[2])

    def reads_all(self, node: str, machines: int) -> bool:
        """Tell whether a node is alone, and has heard every machine itself."""
        (first, *others) = self.ask(node)["nodes"]
        alone = not others and first["name"] == node
        return bool(alone and first["parts"] == 64 and first["machines"] == machines)

    def shows(self, node: str, axes: int) -> bool:
        """Tell whether a node shows so many axes as they are, and nothing is missing."""
        try:
            answer = self.ask(node)
        except urllib.error.URLError:
            return False
        there = answer["counts"]["NORMAL"] + answer["counts"]["FAULT"]
        return bool(there == axes == answer["axes"] and not answer["missing"])


@contextmanager
def plant_in(folder: Path, certificates: Path | None = None) -> Iterator[Plant]:
    """A plant with its router; all of its processes end with the context."""
    plant = Plant(folder, certificates)
    try:
        plant.router()
        yield plant
    finally:
        for name in list(plant.processes):
            plant.kill(name)
