"""Fleet nodes on the bus of a plant: who is there, and questions that all of them answer."""

import asyncio
import zlib
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh
from pydantic import ValidationError

from ...messages.fleet import RowsAnswer
from ...messages.names import check_part
from ...messages.plant import Reported, fleet_node, fleet_question
from ...threads import Threads
from ..questions import Answer, Answering

MOST_ANSWER_BYTES = 64_000_000
"""Length of an answer once it is unpacked; a longer one is none."""
MOST_NODES = 64
_ENCODING = "application/zlib"
_LEVEL = 1
_Answer = TypeVar("_Answer", bound=Reported)
_THREADS = Threads("plant questions", 4)


def packed(answer: Reported) -> bytes:
    """Answer as JSON, compressed: that of a thousand machines is long."""
    return zlib.compress(answer.model_dump_json(exclude_defaults=True).encode(), _LEVEL)


def unpacked(model: type[_Answer], payload: bytes) -> _Answer | None:
    """The answer; None if it is too long, or none."""
    unpacking = zlib.decompressobj()
    try:
        text = unpacking.decompress(payload, MOST_ANSWER_BYTES)
        return model.model_validate_json(text) if unpacking.eof else None
    except (zlib.error, ValidationError):
        return None


async def ask_all(
    session: zenoh.Session,
    question: str,
    asked: Reported | None,
    model: type[_Answer],
    timeout_s: float,
) -> dict[str, _Answer]:
    """Answers of the fleet nodes to a question, by the name under which each is heard.

    What does not come in time, or is no answer, is not there.
    """
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    replies: list[tuple[str, bytes]] = []

    def on_reply(reply: zenoh.Reply) -> None:
        if reply.ok is not None and len(replies) < MOST_NODES:
            replies.append((str(reply.ok.key_expr), reply.ok.payload.to_bytes()))

    def on_end() -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(ended.set)

    payload = b"{}" if asked is None else asked.model_dump_json().encode()
    await _THREADS.run(
        session.get,
        fleet_question("*", question),
        zenoh.handlers.Callback(on_reply, on_end, indirect=False),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        payload=payload,
        timeout=timeout_s,
    )
    try:
        async with asyncio.timeout(1.5 * timeout_s):
            await ended.wait()
    except TimeoutError:
        pass
    return await _THREADS.run(_read, list(replies), question, model)


def _read(
    replies: list[tuple[str, bytes]], question: str, model: type[_Answer]
) -> dict[str, _Answer]:
    found = {}
    for key, payload in replies:
        name = key.split("/")[-2]
        answer = unpacked(model, payload)
        if answer is not None and fleet_question(name, question) == key:
            found[name] = answer
    return found


async def ask_rows(session: zenoh.Session, timeout_s: float) -> list[RowsAnswer]:
    """Knowledge of every fleet node; one that answers for another is not heard."""
    answers = await ask_all(session, "rows", None, RowsAnswer, timeout_s)
    return [answer for name, answer in answers.items() if answer.node == name]


def answer_packed(session: zenoh.Session, node: str, question: str, answer: Answer) -> Answering:
    """Answer a question that is put to all fleet nodes, for one of them."""
    return Answering(session, fleet_question(node, question), answer, _ENCODING)


async def present_nodes(session: zenoh.Session, timeout_s: float) -> frozenset[str]:
    """Names of the fleet nodes that are there."""
    replies = await _THREADS.run(
        lambda: list(session.liveliness().get(fleet_node("*"), timeout=timeout_s))
    )
    keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
    return frozenset(key.rpartition("/")[2] for key in keys)


class FleetMembers:
    """Fleet nodes that are there; our own shows presence while it is open.

    Args:
        on_change: called in the loop when the names have changed.
        there: names that are known to be there.
    """

    def __init__(
        self,
        session: zenoh.Session,
        own: str,
        on_change: Callable[[frozenset[str]], None],
        there: frozenset[str] = frozenset(),
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._on_change = on_change
        self._names = {own, *there}
        self._own = own
        liveliness = session.liveliness()
        self._token: Any = liveliness.declare_token(fleet_node(own))
        self._subscriber: Any = liveliness.declare_subscriber(
            fleet_node("*"),
            zenoh.handlers.Callback(self._on_sample, indirect=False),
            history=True,
        )

    @property
    def names(self) -> frozenset[str]:
        """Names, our own among them."""
        return frozenset(self._names)

    def close(self) -> None:
        """Show presence no more; safe twice."""
        for each in (self._subscriber, self._token):
            if each is not None:
                each.undeclare()
        self._subscriber = self._token = None

    def _on_sample(self, sample: zenoh.Sample) -> None:
        """Runs in a thread of Zenoh."""
        name, there = str(sample.key_expr).rpartition("/")[2], sample.kind == zenoh.SampleKind.PUT
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._note, name, there)

    def _note(self, name: str, there: bool) -> None:
        try:
            check_part(name)
        except ValueError:
            return
        before = self.names
        if there and len(self._names) < MOST_NODES:
            self._names.add(name)
        elif not there and name != self._own:
            self._names.discard(name)
        if self.names != before:
            self._on_change(self.names)
