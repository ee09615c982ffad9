"""Condition of every axis that machines put at a Zenoh router of the plant."""

import json
import os
import time

import zenoh
from pydantic import ValidationError

from ..messages.health import AxisHealth
from ..messages.keys import ROOT
from ..messages.topics import HEALTH

_KEYS = f"{ROOT}/*/*/*/{HEALTH.name}"
ANSWER_S, PERIOD_S = 2.0, 1.5
"""Time for an answer, and between two questions: each axis tells its health once a second, s."""
Place = tuple[str, str, str]
"""Site, machine and axis."""


class RouterAwayError(Exception):
    """A router cannot be joined now; the text says why."""


def ask_health(endpoint: str) -> dict[Place, AxisHealth | None]:
    """Health of every axis at a router; None where nothing comes that is new and can be read.

    Publishers answer with their last message, and clocks of machines may differ: it tells of now if
    it is another one than a moment ago. Raises RouterAwayError: no router answers within 2 s.
    """
    try:
        config = zenoh.Config.from_env() if os.environ.get("ZENOH_CONFIG") else zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("listen/endpoints", "[]")
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("connect/timeout_ms", "2000")
        config.insert_json5("scouting/multicast/enabled", "false")
        with zenoh.open(config) as session:
            before = _answers(session)
            time.sleep(PERIOD_S)
            now = _answers(session)
    except zenoh.ZError as error:
        raise RouterAwayError(f"no Zenoh router answers: {error}".partition(" at /")[0]) from None
    return {
        place: _read(payload) if payload != before.get(place) else None
        for place, payload in now.items()
    }


def _answers(session: zenoh.Session) -> dict[Place, bytes]:
    found = {}
    for reply in session.get(_KEYS, target=zenoh.QueryTarget.ALL, timeout=ANSWER_S):
        if reply.ok is not None:
            site, machine, axis = str(reply.ok.key_expr).split("/")[2:5]
            found[site, machine, axis] = reply.ok.payload.to_bytes()
    return found


def _read(payload: bytes) -> AxisHealth | None:
    """Health in a message; members of later versions are left unread."""
    try:
        return AxisHealth.model_validate_json(payload, extra="ignore")
    except ValidationError:
        return None
