"""Rights on the bus: every key by foreign sessions of every kind, and Zenoh's own file."""

import asyncio
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from edge_service.bus import settings
from edge_service.bus.session import Bus
from edge_service.bus.settings import (
    MOST_MESSAGE_BYTES,
    BusConfigurationError,
    BusSettings,
    zenoh_config,
)
from edge_service.messages.keys import MachineKeys
from edge_service.messages.topics import OUTCOME, RAW, TOPICS
from tests.certificates import write_certificates
from tests.drivers.bench import free_port
from tests.nodes.conftest import until

KEYS = MachineKeys("site", "machine")
MARKER = f"{KEYS.root}/marker"
MODES = ["client", "peer", "router"]
ATTACKS = ("**", "feeddrive/**", f"{KEYS.root}/**/preload", f"{KEYS.root}/@component/**")
"""Keys with wildcards, which would reach every subscriber."""


def every_key() -> set[str]:
    components = {KEYS.component("estimate", "X", topic) for topic in TOPICS.values()}
    return {KEYS.key("X", topic) for topic in TOPICS.values()} | components


@contextmanager
def session_of(mode: str, router: Bus) -> Iterator[zenoh.Session]:
    config = zenoh_config(BusSettings(router.endpoint, "client"))
    config.insert_json5("mode", json.dumps(mode))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


def arrived(session: zenoh.Session) -> bool:
    """An answer has come, and with it all that was sent before has been treated."""
    return any(reply.ok for reply in session.get(MARKER))


class Scene:
    """A router that hears everything, and answers for the marker."""

    def __init__(self, router: Bus) -> None:
        self.session = router._session
        self.heard: list[tuple[str, bytes]] = []
        take = zenoh.handlers.Callback(self._take, indirect=False)
        answer = zenoh.handlers.Callback(self._answer, indirect=False)
        keys = ("**", f"{KEYS.root}/@component/**")
        self._held: list[Any] = [self.session.declare_subscriber(key, take) for key in keys]
        self._held.append(self.session.declare_queryable(MARKER, answer, complete=True))

    def _take(self, sample: zenoh.Sample) -> None:
        self.heard.append((str(sample.key_expr), sample.payload.to_bytes()))

    @staticmethod
    def _answer(query: zenoh.Query) -> None:
        with query:
            query.reply(MARKER, b"here")

    def keys(self) -> set[str]:
        return {key for key, _ in self.heard}

    def answered(self) -> set[str]:
        """Keys for which anybody else answers a query."""
        replies = [reply for key in every_key() for reply in self.session.get(key)]
        return {str(reply.ok.key_expr) for reply in replies if reply.ok}

    def present(self) -> set[str]:
        replies = self.session.liveliness().get("feeddrive/v1/*/*/@alive")
        return {str(reply.ok.key_expr) for reply in replies if reply.ok}


@pytest.mark.parametrize("mode", MODES)
async def test_nobody_puts_answers_or_appears(mode: str, router: Bus) -> None:
    scene = Scene(router)

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"forged")

    with session_of(mode, router) as session:
        callback = zenoh.handlers.Callback(reply, indirect=False)
        held: list[Any] = [session.declare_queryable(key, callback) for key in every_key()]
        held.append(session.liveliness().declare_token(KEYS.alive))
        for key in (*every_key(), *ATTACKS):
            session.put(key, b"forged")
            session.delete(key)
        await until(lambda: asyncio.to_thread(arrived, session))
        assert scene.heard == []
        assert scene.answered() == scene.present() == set()


@pytest.mark.parametrize("mode", MODES)
async def test_everybody_hears_everything_and_commands_nothing(mode: str, router: Bus) -> None:
    heard, asked = set[str](), list[str]()
    take = zenoh.handlers.Callback(lambda s: heard.add(str(s.key_expr)), indirect=False)

    def answer(key: str, _question: bytes, reply: Callable[[bytes | None], None]) -> None:
        asked.append(key)
        reply(b"done" if key == KEYS.key("X", OUTCOME) else None)

    answering = router.answer(KEYS.all_axes(OUTCOME), answer)
    scene = Scene(router)

    def publish() -> bool:
        for key in every_key():
            router._session.put(key, b"true")
        return arrived(session) and every_key() <= heard

    with session_of(mode, router) as session:
        session.declare_subscriber("feeddrive/v1/*/*/*/*", take)
        session.declare_subscriber(f"{KEYS.root}/@component/**", take)
        await until(lambda: asyncio.to_thread(publish))
        for key in (KEYS.key("X", OUTCOME), "**", KEYS.all_axes(OUTCOME)):
            replies = await asyncio.to_thread(lambda k=key: list(session.get(k, payload=b"x")))
            assert b"done" not in [each.ok.payload.to_bytes() for each in replies if each.ok]
    assert scene.keys() == every_key()
    answering.close()


async def test_zenohs_own_file_adds_endpoints_with_tls(tmp_path: Path) -> None:
    certificate, key = write_certificates(tmp_path)
    place = f"tls/127.0.0.1:{free_port()}"
    tls = {"root_ca_certificate": str(tmp_path / "ca.pem")}
    own = {"listen_certificate": str(certificate), "listen_private_key": str(key)}
    listening, joining = tmp_path / "router.json5", tmp_path / "client.json5"
    written = {
        listening: {"listen": {"endpoints": [place]}, "transport": {"link": {"tls": tls | own}}},
        joining: {"connect": {"endpoints": [place]}, "transport": {"link": {"tls": tls}}},
    }
    for path, content in written.items():
        path.write_text(json.dumps(content))
    router = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", zenoh_file=listening))
    scene = Scene(router)
    reader = await Bus.open(BusSettings("tcp/127.0.0.1:1", "client", zenoh_file=joining))
    session = reader._session
    await until(lambda: asyncio.to_thread(arrived, session))
    session.put(KEYS.key("X", RAW), b"forged")
    await until(lambda: asyncio.to_thread(arrived, session))
    assert scene.heard == []  # the rule holds for every endpoint
    await reader.close()
    await router.close()


@pytest.mark.parametrize("content", ["{a:", "{ listen: 3 }", None])
async def test_a_file_zenoh_does_not_take_is_named(content: str | None, tmp_path: Path) -> None:
    path = tmp_path / "zenoh.json5"
    if content is not None:
        path.write_text(content)
    with pytest.raises(BusConfigurationError, match=r"^bus\.zenoh_file: \S+zenoh\.json5: [^/]*$"):
        await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", zenoh_file=path))


async def test_a_payload_beyond_all_bounds_is_dropped_and_others_go_on() -> None:
    router = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router", read_only=False))
    scene, key = Scene(router), KEYS.key("X", RAW)

    def publish() -> bool:
        good.put(key, b"good")
        return arrived(good) and bool(scene.heard)

    with session_of("client", router) as bad, session_of("client", router) as good:
        bad.put(key, bytes(MOST_MESSAGE_BYTES + 1))
        await until(lambda: asyncio.to_thread(publish))
    assert {payload for _, payload in scene.heard} == {b"good"}
    await router.close()


async def test_sessions_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(settings._ROUTER, "transport/unicast/max_sessions", 3)
    bus = await Bus.open(BusSettings("tcp/127.0.0.1:0", "router"))
    with ExitStack() as held:
        for _ in range(2):
            held.enter_context(session_of("client", bus))
        with pytest.raises(zenoh.ZError):
            for _ in range(3):
                held.enter_context(session_of("client", bus))
    await bus.close()
