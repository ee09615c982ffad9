"""The live stream: server-sent events, resumable, with a bounded backlog per reader."""

import json
from collections import Counter
from collections.abc import AsyncIterator
from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Depends, Header, Query, Request
from fastapi.responses import StreamingResponse
from fastapi.sse import format_sse_event
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from ..health.service_state import ServiceState
from ..health.store.events import StoredEvent
from ..health.store.readers import Subscription, concerns
from ..messages.addresses import is_loopback
from ..messages.interval import rfc3339
from ..messages.topics import FEAT, HEALTH, PRELOAD
from .context import QUESTIONS, AxisFilterDep, ClockDep, StateDep, part
from .guard import AuthenticatorDep
from .problems import RefusedError
from .routes.service import OutputAnswer, Outputs, output_items, service_answer

MOST_READERS, MOST_READERS_OF_ONE = 64, 16
REFRESH_S = 1.0
"""Every value is sent again after this long, so that a reader sees it grow old."""
RETRY_MS = 2000
_PAGE = 500
_REFRESHED = PRELOAD.name, HEALTH.name
_SHARED_NS, _OUTPUTS_NS = 20_000_000, 900_000_000

stream_router = APIRouter(prefix="/api/v1", tags=["live"])


async def reader(
    request: Request,
    state: StateDep,
    axis: AxisFilterDep,
    held: Annotated[Counter[str], part("readers_of")],
) -> AsyncIterator[Subscription]:
    """A place among the live readers, and among those of the client's address, until the end.

    Loopback may stand for many people.
    """
    address = request.client.host if request.client else ""
    if held[address] >= MOST_READERS_OF_ONE and not is_loopback(address):
        raise HTTPException(429, f"{MOST_READERS_OF_ONE} live readers of {address} are connected")
    if len(state.readers) >= MOST_READERS:
        raise HTTPException(503, f"{MOST_READERS} live readers are connected; no more are accepted")
    held[address] += 1
    try:
        with state.readers.subscribe(axis) as subscription:
            yield subscription
    finally:
        held[address] -= 1
        held += Counter()  # forgets addresses without readers


class Encoded:
    """The newest message of each topic, made once for all readers that ask at the same moment."""

    def __init__(self, state: ServiceState, outputs: Outputs | None) -> None:
        self._state, self._outputs = state, outputs
        self._made: dict[tuple[str, str], tuple[int, int, bytes]] = {}
        self._items: tuple[int, list[OutputAnswer]] | None = None

    def value(self, topic: str, axis: str, now_ns: int) -> bytes:
        """The message as of now, or of at most a few milliseconds ago; empty if there is none."""
        if axis not in self._state.axes:
            return b""
        version = self._state.version(topic, axis)
        made = self._made.get((topic, axis))
        if made is None or made[0] != version or not 0 <= now_ns - made[1] <= _SHARED_NS:
            message = self._message(topic, axis, now_ns)
            made = self._made[topic, axis] = (version, now_ns, message)
        return made[2]

    async def service(self, now_ns: int) -> bytes:
        """Health of the service, with outputs as they were within a second."""
        if self._items is None or abs(now_ns - self._items[0]) >= _OUTPUTS_NS:
            try:
                items = await output_items(self._state, now_ns, self._outputs)
            except RefusedError:  # the store cannot be read now; the parts say so
                items = []
            self._items = now_ns, items
        return _named("service", service_answer(self._state, now_ns, self._items[1]))

    def _message(self, topic: str, axis: str, now_ns: int) -> bytes:
        if topic != FEAT.name:
            answer = self._state.preload if topic == PRELOAD.name else self._state.health
            return _named(topic, answer(axis, now_ns))
        point = self._state.live(axis).newest
        if point is None:
            return b""
        members = asdict(point) | {"axis": axis, "time": rfc3339(point.time_ns)}
        del members["time_ns"]
        return format_sse_event(event="live", data_str=json.dumps(members))


@stream_router.get(
    "/events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}}},
)
async def events(
    request: Request,
    state: StateDep,
    clock: ClockDep,
    encoded: Annotated[Encoded, part("encoded")],
    authenticator: AuthenticatorDep,
    subscription: Annotated[Subscription, Depends(reader)],
    last_event_id: Annotated[
        int | None, Query(ge=0, description="Same as the header Last-Event-ID.")
    ] = None,
    header: Annotated[
        int | None,
        Header(
            alias="Last-Event-ID",
            ge=0,
            description="Id of the last event received; the events after it are sent first.",
        ),
    ] = None,
) -> StreamingResponse:
    """Live stream: `event` (numbered); `preload`, `health`, `live`, `service` (newest); `lost`.

    Events can be resumed after `Last-Event-ID`, or after `last_event_id` (0: all that are kept).
    """
    resume_id = last_event_id if header is None else header  # that of a reconnection wins

    async def messages() -> AsyncIterator[bytes]:
        seen_id = 0 if resume_id is None else resume_id
        first_id = await QUESTIONS.run(state.events.last_id) if resume_id is None else resume_id
        yield format_sse_event(id=str(first_id), retry=RETRY_MS)
        if resume_id and not await QUESTIONS.run(state.events.holds_all_after, resume_id):
            yield _lost(None, "older events are no longer kept")
        while resume_id is not None and (
            missed := await QUESTIONS.run(state.events.after, seen_id, _PAGE)
        ):
            seen_id = missed[-1].id
            kept = (each for each in missed if concerns(each.event, subscription.axis))
            yield b"".join(map(_event, kept))
        refreshed_ns: int | None = None
        while not subscription.closed:
            now_ns = clock()
            if refreshed_ns is None or abs(now_ns - refreshed_ns) >= REFRESH_S * 1e9:
                if authenticator.caller(request) is None:  # its token was revoked
                    return
                refreshed_ns = now_ns
                told = [format_sse_event(comment="keep-alive"), await encoded.service(now_ns)]
                for each in state.axes if subscription.axis is None else (subscription.axis,):
                    told += (encoded.value(name, each, now_ns) for name in _REFRESHED)
                yield b"".join(told)
            batch = await subscription.next(REFRESH_S)
            told = [_lost(batch.lost, "this reader is too slow")] if batch.lost else []
            told += (_event(logged) for logged in batch.events if logged.id > seen_id)
            now_ns = clock()
            told += (encoded.value(topic, each, now_ns) for topic, each in batch.changed)
            yield b"".join(told)

    headers = {"cache-control": "no-cache", "x-accel-buffering": "no"}
    return StreamingResponse(messages(), media_type="text/event-stream", headers=headers)


def _event(logged: StoredEvent) -> bytes:
    data = logged.event.model_dump_json()
    return format_sse_event(event="event", id=str(logged.id), data_str=data)


def _lost(count: int | None, reason: str) -> bytes:
    """Events that this reader will not see; `count` is null if nobody knows how many."""
    return format_sse_event(event="lost", data_str=json.dumps({"count": count, "reason": reason}))


def _named(event: str, answer: BaseModel) -> bytes:
    return format_sse_event(event=event, data_str=answer.model_dump_json())
