"""A service with tokens of every role, and clients that show one, another or none."""

from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from pathlib import Path

import httpx
import pytest

from edge_service.health.service_state import ServiceState
from edge_service.http_api.app import create_app
from edge_service.http_api.security.doorkeeper import Doorkeeper
from edge_service.http_api.security.tokens import TokenFile, add_token, utc
from edge_service.messages.alarm import Command, Outcome

START_NS = 1_769_860_800_000_000_000
DAY_S = 86400.0
ROLES = ("viewer", "operator", "admin")


@dataclass
class Guarded:
    """A service that asks for tokens, with clocks that the test moves."""

    path: Path
    now_ns: int = START_NS
    monotonic_s: float = 0.0
    sent: list[Command] = field(default_factory=list)
    secrets: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for role in ROLES:
            self.secrets[role] = add_token(self.path, f"{role} 1", role, 30, utc(self.now_ns))
        tokens = TokenFile(self.path)
        self.doorkeeper = Doorkeeper(tokens, lambda: self.now_ns, lambda: self.monotonic_s)
        self.state = ServiceState({"X": None}, self.now_ns)
        self.app = create_app(
            self.state,
            lambda: self.now_ns,
            hosts=["box", "127.0.0.1"],
            send_command=self._send,
            doorkeeper=self.doorkeeper,
        )

    async def _send(self, _axis: str, command: Command) -> Outcome:
        self.sent.append(command)
        return Outcome(accepted=True)

    def wait(self, seconds: float) -> None:
        """Let time pass on both clocks."""
        self.now_ns += round(seconds * 1e9)
        self.monotonic_s += seconds

    def bearer(self, role: str) -> dict[str, str]:
        """Headers of a program; none for a role without a token."""
        secret = self.secrets.get(role)
        return {} if secret is None else {"authorization": f"Bearer {secret}"}


@pytest.fixture
def guarded(tmp_path: Path) -> Guarded:
    return Guarded(tmp_path / "tokens.json")


Connect = Callable[..., httpx.AsyncClient]


@pytest.fixture
async def connect(guarded: Guarded) -> AsyncIterator[Connect]:
    """Makes clients of the guarded service, each with cookies of its own."""
    clients: list[httpx.AsyncClient] = []

    def connect(
        base_url: str = "https://box:8443", address: str = "192.0.2.7"
    ) -> httpx.AsyncClient:
        transport = httpx.ASGITransport(guarded.app, client=(address, 50000))
        clients.append(httpx.AsyncClient(transport=transport, base_url=base_url))
        return clients[-1]

    yield connect
    for client in clients:
        await client.aclose()
