"""Identity of whoever asks: by a token, by the session of a browser, or nobody."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime

from ...clock import now_ns, steady_ns
from .access import Role
from .attempts import Attempts
from .sessions import Sessions
from .tokens import Token, TokenError, TokenFile, digest, utc

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity and rights of a request; `name` is None where nobody has proved one."""

    name: str | None
    role: Role


ANYBODY = Identity(None, Role.ADMIN)
"""Whoever reaches a service without tokens."""
NOBODY = Identity(None, Role.NOBODY)


class LimitedError(Exception):
    """Too many sign-ins failed; another one may be tried after `wait_s`."""

    def __init__(self, wait_s: float) -> None:
        super().__init__(f"too many sign-ins have failed; try again in {wait_s:.0f} s")
        self.wait_s = wait_s


@dataclass
class Doorkeeper:
    """Tells who asks, and lets browsers sign in and out.

    Attributes:
        tokens: None: there are none, and whoever reaches the service may do anything.
        clock: UNIX time in ns, by which tokens end.
        monotonic: s, also of a suspended host, by which sessions end and failures are forgotten.
    """

    tokens: TokenFile | None = None
    clock: Callable[[], int] = now_ns
    monotonic: Callable[[], float] = lambda: steady_ns() / 1e9
    _sessions: Sessions = field(default_factory=Sessions)
    _attempts: Attempts = field(default_factory=Attempts)
    _complaint: str = ""

    def identify(self, authorization: str, session_secret: str) -> Identity:
        """Identity of a request; a token that is sent decides alone, else the browser's session.

        Args:
            authorization: The header, such as `Bearer edge-...`; empty if there is none.
            session_secret: What the browser holds; empty if nothing.
        """
        if self.tokens is None:
            return ANYBODY
        scheme, _, secret = authorization.partition(" ")
        if scheme.lower() == "bearer":
            return _identity(self._token(digest(secret.strip())))
        session = self._sessions.find(session_secret, self.monotonic())
        return NOBODY if session is None else _identity(self._token(session.token_sha256))

    def sign_in(self, secret: str, client: str) -> tuple[Identity, str]:
        """Begin a session with a token; returns who it is, and the secret for the browser.

        Raises:
            LimitedError: too many have failed lately.
            PermissionError: it is no token.
        """
        now_s = self.monotonic()
        wait_s = self._attempts.wait_s(client, now_s)
        if wait_s > 0.0:
            raise LimitedError(wait_s)
        token = self._token(digest(secret))
        if token is None:
            self._attempts.failed(client, now_s)
            log.warning("sign-in from %s failed", client)
            raise PermissionError
        log.info("sign-in of %s (%s) from %s", token.name, token.role, client)
        return _identity(token), self._sessions.begin(token.sha256, now_s)

    def sign_out(self, session_secret: str) -> None:
        """End the session of a browser; safe without one."""
        self._sessions.end(session_secret)

    def _token(self, sha256: str) -> Token | None:
        """A token that holds now; none of a file that cannot be read, which is said once."""
        assert self.tokens is not None
        try:
            token = self.tokens.find(sha256, self._now())
            self._complaint = ""
            return token
        except TokenError as error:
            if str(error) != self._complaint:
                self._complaint = str(error)
                log.error("%s; all sign-ins are refused", error)
            return None

    def _now(self) -> datetime:
        return utc(self.clock())


def _identity(token: Token | None) -> Identity:
    return NOBODY if token is None else Identity(token.name, token.rank)
