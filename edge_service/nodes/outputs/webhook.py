"""Events to another system by HTTP POST: signed, in order, tried again until they arrive."""

import asyncio
import hashlib
import hmac
import http.client
import json
import logging
import time
import urllib.error
import urllib.request
from collections import deque
from collections.abc import Awaitable, Callable
from pathlib import Path

from ...config import ConfigError, EdgeConfig
from ...messages.event import Event
from ...messages.topics import EVENT
from ..supervision.heartbeat import Heartbeat

log = logging.getLogger(__name__)
MOST_WAITING = 1000
FIRST_PAUSE_S = 1.0
LONGEST_PAUSE_S = 60.0
_TIMEOUT_S = 10.0
SIGNATURE = "X-Edge-Signature"
TIMESTAMP = "X-Edge-Timestamp"


class WebhookError(Exception):
    """Refusal of an event; `again` says whether another try may help."""

    def __init__(self, message: str, *, again: bool) -> None:
        super().__init__(message)
        self.again = again


def sign(secret: bytes, timestamp: str, body: bytes) -> str:
    """`sha256=` and the HMAC-SHA256 of `{timestamp}.{body}` in hex."""
    return "sha256=" + hmac.new(secret, f"{timestamp}.".encode() + body, hashlib.sha256).hexdigest()


class Webhook:
    """A bounded queue of events and who sends them; without a URL it takes none.

    The oldest event is sent first and tried again, with growing pauses, until the other side
    answers 2xx, or 4xx other than 408 and 429, which no further try would change. When the queue
    is full the oldest waiting event is dropped and counted. All events are in the log anyway.
    """

    def __init__(
        self,
        url: str | None,
        secret: bytes,
        kinds: tuple[str, ...],
        sleep: Callable[[float], Awaitable[None]] = asyncio.sleep,
    ) -> None:
        self._url = url
        self._secret = secret
        self._kinds = frozenset(kinds)
        self._waiting: deque[Event] = deque(maxlen=MOST_WAITING)
        self._sending: Event | None = None
        self._wake = asyncio.Event()
        self._sleep = sleep
        self.dropped = self.refused = self.sent = 0

    @classmethod
    def of(cls, config: EdgeConfig) -> "Webhook":
        """As configured. Raises ConfigError if the secret cannot be read."""
        settings = config.webhook
        if settings.url is None or settings.secret_file is None:
            return cls(None, b"", ())
        return cls(settings.url, _secret(settings.secret_file), settings.kinds)

    def put(self, event: Event) -> None:
        """Let an event be sent, if it is of a configured kind."""
        if self._url is None or event.kind not in self._kinds:
            return
        if len(self._waiting) == MOST_WAITING:
            self.dropped += 1
        self._waiting.append(event)
        self._wake.set()

    async def run(self, heart: Heartbeat) -> None:
        """Send until cancelled; begun again, it goes on with the event that it was at."""
        while True:
            if self._sending is None and self._waiting:
                self._sending = self._waiting.popleft()
            if self._sending is not None:
                await self._deliver(self._sending, heart)
                self._sending = None
                continue
            self._wake.clear()
            with heart.idle(lambda: not self._waiting):
                await self._wake.wait()

    async def _deliver(self, event: Event, heart: Heartbeat) -> None:
        pause_s, logged = FIRST_PAUSE_S, False
        while True:
            try:
                await heart.in_thread(self._post, event, limit_s=2.0 * _TIMEOUT_S)
            except WebhookError as error:
                if not logged:
                    log.warning("webhook %s: %s", self._url, error)
                logged = True
                if not error.again:
                    self.refused += 1
                    return
                heart.beat(pause_s)
                await self._sleep(pause_s)
                pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)
            else:
                self.sent += 1
                return

    def _post(self, event: Event) -> None:
        body = json.dumps({"schema": EVENT.payload} | event.model_dump(mode="json")).encode()
        timestamp = str(int(time.time()))
        headers = {
            "Content-Type": "application/json",
            TIMESTAMP: timestamp,
            SIGNATURE: sign(self._secret, timestamp, body),
        }
        request = urllib.request.Request(str(self._url), body, headers, method="POST")
        try:
            with urllib.request.urlopen(request, timeout=_TIMEOUT_S):
                return
        except urllib.error.HTTPError as error:
            again = error.code >= 500 or error.code in (408, 429)
            error.close()
            raise WebhookError(f"answered {error.code}", again=again) from None
        except (OSError, http.client.HTTPException, ValueError) as error:
            raise WebhookError(f"cannot be reached ({error})", again=True) from None


def _secret(path: Path) -> bytes:
    try:
        secret = path.read_bytes().strip()
    except OSError as error:
        raise ConfigError(f"webhook.secret_file: {path}: {error.strerror}") from None
    if len(secret) < 16:
        raise ConfigError(f"webhook.secret_file: {path}: expected at least 16 characters")
    return secret
