"""Sessions of browsers: kept here and nowhere else, so that they can be ended here."""

import secrets
from collections import OrderedDict
from dataclasses import dataclass

from .tokens import digest

LIFETIME_S = 12 * 3600.0
MOST_SESSIONS = 256
_BYTES = 32


@dataclass(frozen=True, slots=True)
class Session:
    """A session of the token with this hash, until a moment of the monotonic clock."""

    token_sha256: str
    until_s: float


class Sessions:
    """Open sessions by the hash of what the browser holds; of too many the oldest go."""

    def __init__(self) -> None:
        self._open: OrderedDict[str, Session] = OrderedDict()

    def begin(self, token_sha256: str, now_s: float) -> str:
        """Begin a session; returns the secret for the browser."""
        secret = secrets.token_urlsafe(_BYTES)
        self._open[digest(secret)] = Session(token_sha256, now_s + LIFETIME_S)
        if len(self._open) > MOST_SESSIONS:
            self._open.popitem(last=False)
        return secret

    def find(self, secret: str, now_s: float) -> Session | None:
        """The session of a browser, unless it has ended."""
        session = self._open.get(digest(secret))
        if session is not None and now_s >= session.until_s:
            self.end(secret)
            return None
        return session

    def end(self, secret: str) -> None:
        """End a session; safe without one."""
        self._open.pop(digest(secret), None)
