"""Rights, tried: every route by every role, and every key of the bus by every role.

`python -m tests.bench.faults.access` prints both tables as they were found on a real service with
TLS, tokens and certificates; it ends with 1 where one differs from the tables of the product.
"""

import asyncio
import ssl
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click
import httpx
import zenoh

from edge_service.bus.access import PUTS, client_name, may_put
from edge_service.bus.session import Bus
from edge_service.bus.settings import BusSettings, TlsSettings, zenoh_config
from edge_service.certificates import make_certificates
from edge_service.config import load_config
from edge_service.http_api.security.access import ROUTES, Role
from edge_service.http_api.security.tokens import RoleName, add_token
from edge_service.messages.topics import TOPICS
from edge_service.nodes.service import PIPELINE, run_nodes
from edge_service.nodes.wiring.bus_rights import router_settings
from edge_service.nodes.wiring.context import NodeContext

from .scene import configuration

ROLES: tuple[RoleName, ...] = ("viewer", "operator", "admin")
_FILLED = {"axis": "Q", "form": "arrow", "path": "app.js", "number": "9", "name": "none.csv"}
_FILLED |= {"output": "none", "letter": "none"}
_TLS = """
[http]
port = 0
certificate = "server.pem"
private_key = "server.key"
tokens_file = "tokens.json"
[bus]
endpoint = "tcp/127.0.0.1:0"
tls_endpoint = "tls/127.0.0.1:0"
certificates = "."
"""
_SETTLE_S = 0.5
_PATIENCE_S = 5.0


def request_path(path: str) -> str:
    """A path that a route takes, of things that do not exist."""
    for name, value in _FILLED.items():
        path = path.replace(f"{{{name}:path}}", value).replace(f"{{{name}}}", value)
    return path


async def status_of(client: httpx.AsyncClient, method: str, path: str, secret: str) -> int:
    """Status of the answer; of the live stream as soon as it begins."""
    headers = {"authorization": f"Bearer {secret}"} if secret else {}
    async with client.stream(method, request_path(path), headers=headers) as answer:
        return answer.status_code


async def routes(address: str, folder: Path, secrets: dict[Role, str]) -> int:
    """Print the table of routes; returns how many cells are wrong."""
    trusted = ssl.create_default_context(cafile=str(folder / "ca.pem"))
    wrong = 0
    click.echo(f"{'route':58}" + "".join(f"{role.name.lower():>10}" for role in Role))
    async with httpx.AsyncClient(base_url=address, verify=trusted) as client:
        for path, methods in ROUTES.items():
            for method, needed in methods.items():
                found = [await status_of(client, method, path, secrets[role]) for role in Role]
                good = [
                    (status not in (401, 403)) == (role >= needed)
                    for status, role in zip(found, Role, strict=True)
                ]
                wrong += good.count(False)
                click.echo(
                    f"{f'{method} {path}':58}" + "".join(f"{status:>10}" for status in found)
                )
    return wrong


@contextmanager
def session_of(role: str, bus: Bus, folder: Path) -> Iterator[zenoh.Session]:
    """A session with the certificate of a role, or by TCP without one."""
    tls = None
    if role in PUTS:
        tls = TlsSettings.of_folder(bus.tls_endpoint or "", folder, role)
    session = zenoh.open(zenoh_config(BusSettings(bus.endpoint, "client", tls=tls)))
    try:
        yield session
    finally:
        session.close()


async def keys(bus: Bus, folder: Path) -> int:
    """Print the table of keys; returns how many cells are wrong."""
    wrong = 0
    click.echo(f"\n{'put by':14}" + "".join(f"{name:>10}" for name in TOPICS))
    for role in (*PUTS, "tcp"):
        heard = await asyncio.to_thread(heard_of, role, bus, folder)
        allowed = (
            {each.rpartition("/")[2] for each in may_put(role) if "@" not in each}
            if role in PUTS
            else set()
        )
        wrong += len(heard ^ allowed)
        cells = ("allowed" if name in heard else "-" for name in TOPICS)
        click.echo(f"{role:14}" + "".join(f"{cell:>10}" for cell in cells))
    return wrong


def heard_of(role: str, bus: Bus, folder: Path) -> set[str]:
    """Topics whose payloads of a role reach the bus."""
    heard: set[str] = set()
    take: Any = zenoh.handlers.Callback(
        lambda sample: heard.add(str(sample.key_expr).rpartition("/")[2]), indirect=False
    )
    root = "feeddrive/v1/forged/machine/Q"
    subscriber = bus._session.declare_subscriber(f"{root}/*", take)
    with session_of(role, bus, folder) as session:
        for _ in range(2):
            for name in TOPICS:
                session.put(f"{root}/{name}", b"forged")
            asyncio.run(asyncio.sleep(_SETTLE_S))
    subscriber.undeclare()
    return heard


async def measure(folder: Path) -> int:
    """Run the service and try both tables; returns how many cells are wrong."""
    make_certificates(folder, (), {role: client_name(role) for role in PUTS}, 31)
    now = datetime.now(UTC)
    secrets = {Role.NOBODY: ""}
    for name in ROLES:
        secrets[Role[name.upper()]] = add_token(folder / "tokens.json", name, name, 1, now)
    axes = configuration().partition("[[axes]]")
    path = folder / "edge.toml"
    path.write_text(_TLS + axes[1] + axes[2])
    config = load_config(path)
    bus = await Bus.open(router_settings(config))
    address: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    stop = asyncio.Event()
    task = asyncio.create_task(
        run_nodes(NodeContext(config, bus, address.set_result), PIPELINE, stop)
    )
    try:
        served = await asyncio.wait_for(address, _PATIENCE_S * 10)
        return await routes(served, folder, secrets) + await keys(bus, folder)
    finally:
        stop.set()
        await asyncio.wait([task])
        await bus.close()


def main() -> int:
    """Both tables; 1 if a cell is wrong."""
    with tempfile.TemporaryDirectory() as folder:
        wrong = asyncio.run(measure(Path(folder)))
    cells = sum(map(len, ROUTES.values())) * len(Role) + (len(PUTS) + 1) * len(TOPICS)
    click.echo(f"\n{cells} cells, {wrong} wrong")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
