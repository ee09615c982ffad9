"""Who may do what on the bus: every key of the table by every role, with real sessions."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from edge_service.bus.access import COMMANDER, PUTS, READER, client_name
from edge_service.bus.session import Bus, BusConfigurationError, BusUnavailableError
from edge_service.bus.settings import (
    MOST_MESSAGE_BYTES,
    BusSettings,
    Security,
    TlsSettings,
    zenoh_config,
)
from edge_service.certificates import make_certificates
from edge_service.messages.keys import MachineKeys
from edge_service.messages.outputs import OF_HTTP
from edge_service.messages.topics import EVENT, OUTCOME, RAW, STATUS, TOPICS

KEYS = MachineKeys("site", "machine")
OTHERS = MachineKeys("site", "other")
MARKER = f"{KEYS.root}/marker"
ROLES = [*PUTS, "tcp client", "tcp peer", "tcp router"]
ATTACKS = ("**", "feeddrive/**", f"{KEYS.root}/**/preload", f"{KEYS.root}/@component/**")
"""Keys with wildcards, which would reach every subscriber."""


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    make_certificates(folder, (), {role: client_name(role) for role in PUTS}, 1)
    return folder


def tls(folder: Path, name: str, endpoint: str = "tls/127.0.0.1:0") -> TlsSettings:
    return TlsSettings.of_folder(endpoint, folder, name)


async def open_router(folder: Path, security: Security = "readers") -> Bus:
    settings = BusSettings("tcp/127.0.0.1:0", "router", security, tls(folder, "server"))
    return await Bus.open(settings)


@pytest.fixture
async def router(certificates: Path) -> AsyncIterator[Bus]:
    bus = await open_router(certificates)
    yield bus
    await bus.close()


@contextmanager
def session_of(role: str, router: Bus, folder: Path) -> Iterator[zenoh.Session]:
    """A session with the certificate of a role, or a foreign one by TCP in some mode."""
    secure = None if role.startswith("tcp ") else tls(folder, role, router.tls_endpoint or "")
    config = zenoh_config(BusSettings(router.endpoint, "client", tls=secure))
    if secure is None:
        config.insert_json5("mode", json.dumps(role.removeprefix("tcp ")))
    session = zenoh.open(config)
    try:
        yield session
    finally:
        session.close()


def arrived(session: zenoh.Session) -> bool:
    """Tell whether an answer has come, and with it all that was sent before has been treated."""
    return any(reply.ok for reply in session.get(MARKER))


async def until(done: Callable[[], bool]) -> None:
    """Declarations travel asynchronously: try again, for a while."""
    async with asyncio.timeout(30.0):
        while not await asyncio.to_thread(done):
            await asyncio.sleep(0)


def own_keys(role: str) -> set[str]:
    """Keys of what a node says of itself: of its component, with and without axis; its process."""
    components = [(role, None), (role, "X"), (f"{role}_process", None)]
    components += [(name, None) for name in ("history", *OF_HTTP)] if role == "http" else []
    return {KEYS.component(*each, topic) for each in components for topic in (STATUS, EVENT)}


def allowed_keys(role: str) -> set[str]:
    """Keys that the table lets a role put."""
    if role == READER or role not in PUTS:
        return set()
    return {KEYS.key("X", topic) for topic in PUTS[role]} | own_keys(role)


def every_key() -> set[str]:
    """Keys of every topic, and of what every component says of itself, and the whole service."""
    others = [KEYS.component("service", None, topic) for topic in TOPICS.values()]
    of_components = {key for role in PUTS for key in own_keys(role)}
    return {KEYS.key("X", topic) for topic in TOPICS.values()} | of_components | {*others}


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


@pytest.mark.parametrize("role", ROLES)
async def test_a_role_puts_what_the_table_allows_and_nothing_else(
    role: str, router: Bus, certificates: Path
) -> None:
    scene, allowed = Scene(router), allowed_keys(role)

    def attack() -> bool:
        for key in (*every_key(), *ATTACKS):
            session.put(key, b"forged")
        for key in (*(every_key() - allowed), *ATTACKS):
            session.delete(key)
        return arrived(session) and allowed <= scene.keys()

    with session_of(role, router, certificates) as session:
        await until(attack)
        assert scene.keys() == allowed
        for key in allowed:
            session.delete(key)
        assert arrived(session)
    assert b"" not in {payload for _, payload in scene.heard}, "something was deleted"


@pytest.mark.parametrize("role", ROLES)
async def test_a_role_answers_for_what_it_may_put_and_nothing_else(
    role: str, router: Bus, certificates: Path
) -> None:
    scene, allowed = Scene(router), allowed_keys(role)
    node = bool(allowed)

    def reply(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"forged")

    def answered() -> bool:
        return arrived(session) and allowed <= scene.answered()

    with ExitStack() as held:
        session = held.enter_context(session_of(role, router, certificates))
        callback = zenoh.handlers.Callback(reply, indirect=False)
        declared = [session.declare_queryable(key, callback) for key in every_key()]
        tokens = [session.liveliness().declare_token(keys.alive) for keys in (KEYS, OTHERS)]
        await until(answered)
        assert scene.answered() == allowed
        await until(lambda: bool(scene.present()) == node)
        assert len(declared) + len(tokens) == len(every_key()) + 2


@pytest.mark.parametrize("role", ROLES)
async def test_every_role_hears_everything_and_asks_for_everything(
    role: str, router: Bus, certificates: Path
) -> None:
    scene, heard = Scene(router), set[str]()
    take = zenoh.handlers.Callback(lambda s: heard.add(str(s.key_expr)), indirect=False)
    held = [router._session.liveliness().declare_token(KEYS.alive)]

    def publish() -> bool:
        for key in every_key():
            router._session.put(key, b"true")
        return arrived(session) and every_key() <= heard

    with session_of(role, router, certificates) as session:
        session.declare_subscriber("feeddrive/v1/*/*/*/*", take)
        session.declare_subscriber(f"{KEYS.root}/@component/**", take)
        await until(publish)
        replies = session.liveliness().get(KEYS.alive)
        assert [str(reply.ok.key_expr) for reply in replies if reply.ok] == [KEYS.alive]
    assert len(held) == 1
    assert scene.keys() == every_key()


@pytest.mark.parametrize("role", ROLES)
async def test_a_command_can_be_asked_of_the_monitor_by_the_page_alone(
    role: str, router: Bus, certificates: Path
) -> None:
    asked: list[str] = []

    def answer(key: str, _question: bytes, reply: Callable[[bytes | None], None]) -> None:
        asked.append(key)
        reply(b"done" if key == KEYS.key("X", OUTCOME) else None)

    answering = router.answer(KEYS.all_axes(OUTCOME), answer)
    Scene(router)
    with session_of(role, router, certificates) as session:
        await until(lambda: arrived(session))
        replies = await asyncio.to_thread(
            lambda: list(session.get(KEYS.key("X", OUTCOME), payload=b"command"))
        )
        answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok]
        assert answers == ([b"done"] if role == COMMANDER else [])
        for attack in ("**", "feeddrive/**", KEYS.all_axes(OUTCOME)):
            found = await asyncio.to_thread(lambda k=attack: list(session.get(k, payload=b"x")))
            assert b"done" not in [each.ok.payload.to_bytes() for each in found if each.ok]
    assert asked.count(KEYS.key("X", OUTCOME)) == len(answers)
    answering.close()


async def test_every_topic_has_exactly_one_role_that_puts_it() -> None:
    put = [topic.name for topics in PUTS.values() for topic in topics]
    assert sorted([*put, STATUS.name]) == sorted(TOPICS)


async def test_a_payload_beyond_all_bounds_is_dropped_and_others_go_on(
    router: Bus, certificates: Path
) -> None:
    scene, key = Scene(router), KEYS.key("X", RAW)

    def publish() -> bool:
        good.put(key, b"good")
        return arrived(good) and bool(scene.heard)

    with (
        session_of("acquire", router, certificates) as bad,
        session_of("acquire", router, certificates) as good,
    ):
        bad.put(key, bytes(MOST_MESSAGE_BYTES + 1))
        await until(publish)
    assert {payload for _, payload in scene.heard} == {b"good"}


async def test_sessions_are_bounded(certificates: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("edge_service.bus.settings.MOST_SESSIONS", 3)
    bus = await open_router(certificates)
    with ExitStack() as held:
        for _ in range(2):
            held.enter_context(session_of("tcp client", bus, certificates))
        with pytest.raises(zenoh.ZError):
            for _ in range(3):
                held.enter_context(session_of("tcp client", bus, certificates))
    await bus.close()


async def test_foreign_or_missing_certificates_do_not_get_in(
    router: Bus, certificates: Path, tmp_path: Path
) -> None:
    make_certificates(tmp_path, (), {"acquire": client_name("acquire")}, 1)
    there, own = router.tls_endpoint or "", certificates
    mixed = [
        tls(tmp_path, "acquire", there),
        TlsSettings(there, own / "ca.pem", tmp_path / "acquire.pem", tmp_path / "acquire.key"),
        TlsSettings(there, tmp_path / "ca.pem", own / "acquire.pem", own / "acquire.key"),
        TlsSettings(there, own / "ca.pem", own / "server.pem", own / "server.key"),
    ]
    for secure in mixed:
        with pytest.raises(BusUnavailableError, match="refuses the certificate of this process"):
            await Bus.open(BusSettings(router.endpoint, "client", tls=secure))


async def test_a_bus_with_tls_alone_has_no_door_beside_it(certificates: Path) -> None:
    bus = await open_router(certificates, "tls")
    try:
        for door in (bus.endpoint, bus.endpoint.replace("tls/", "tcp/")):
            with pytest.raises((BusConfigurationError, BusUnavailableError)):
                await Bus.open(BusSettings(door, "client"))
    finally:
        await bus.close()
