"""Events by e-mail: those of a short time in one letter, and not more than some in an hour."""

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Sequence

from pydantic import ValidationError

from ....bus.spool.message import Message
from ....bus.spool.spool import Spool
from ....clock import now_ns
from ....config import ConfigError, EdgeConfig
from ....config_tables import EmailConfig
from ....messages.event import Event, Severity
from ..ordered import Answers, OrderedOutput, jittered, open_spool
from ..reply import Outcome, Reply
from .letter import Envelope, letter
from .smtp import WHOLE_S, SmtpSender, trusted

MOST_TOGETHER = 1000
_HOUR_S = 3600.0


class Email(OrderedOutput):
    """Sends events by e-mail.

    A letter waits until its first event has waited for `gather_s`, and until fewer than
    `most_per_hour` have gone in the last hour; then it tells of all that have come. What it tells
    stays the same however often it has to be tried.

    Args:
        settings: server, people and limits.
        machine: `{site}/{machine}`.
        clock: monotonic, s.
    """

    LIMIT_S = WHOLE_S
    BELIEVED = True

    def __init__(
        self,
        settings: EmailConfig,
        machine: str,
        spool: Spool,
        answers: Answers,
        on_change: Callable[[str], None] = lambda _problem: None,
        pause: Callable[[float], asyncio.Timeout] = jittered,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__("email", settings, spool, on_change, pause)
        people = (settings.sender, settings.recipients)
        self._envelope = Envelope(machine, *people, settings.page_url, settings.language)
        self._severities = frozenset(settings.severities)
        self._gather_s, self._most_per_hour = settings.gather_s, settings.most_per_hour
        self._answers, self._clock = answers, clock
        self._sender = SmtpSender(settings)
        self._sent_s: deque[float] = deque(maxlen=settings.most_per_hour)
        self._first, self._since_s = "", 0.0
        self._chosen: list[Message] = []
        self._letter = b""

    @property
    def place(self) -> str:
        """Host and port of the server."""
        return self._sender.place

    def payload(self, event: Event) -> bytes:
        """The event as it is kept."""
        return json.dumps(event.model_dump(mode="json")).encode()

    def wants(self, event: Event) -> bool:
        """Tell whether an event is of a configured kind and severity."""
        return super().wants(event) and event.severity in self._severities

    def due_in_s(self, first: Message) -> float:
        """Time for which others may still join, or in which no letter may go."""
        if self._is_chosen(first):
            return 0.0
        now_s = self._clock()
        if first.key != self._first:
            self._first, self._since_s = first.key, now_s
        due_s = self._since_s + self._gather_s
        if len(self._sent_s) == self._most_per_hour:
            due_s = max(due_s, self._sent_s[0] + _HOUR_S)
        return due_s - now_s

    async def together(self, first: Message) -> list[Message]:
        """All that wait; again the same until they have gone."""
        if not self._is_chosen(first):
            self._chosen = await self.spool.oldest(MOST_TOGETHER)
            self._letter = self._told(self._chosen)
        return self._chosen

    async def send(self, messages: Sequence[Message]) -> Reply:
        """Send one letter about all of them."""
        known = _keys(messages) == _keys(self._chosen)
        reply = await self._sender.send(self._letter if known else self._told(messages))
        if reply.outcome in (Outcome.TAKEN, Outcome.NEVER):
            self._sent_s.append(self._clock())
            self._chosen, self._letter = [], b""
        return reply

    def _is_chosen(self, first: Message) -> bool:
        return bool(self._chosen) and self._chosen[0].key == first.key

    def _told(self, messages: Sequence[Message]) -> bytes:
        events = [_event(each) for each in messages]
        answers = {event.axis: self._answers(event.axis) for event in events}
        return letter(self._envelope, events, _keys(messages), answers, now_ns())


def _keys(messages: Sequence[Message]) -> list[str]:
    return [each.key for each in messages]


def _event(message: Message) -> Event:
    """Event that was kept; what another version has kept is told as far as it is understood."""
    try:
        return Event.model_validate_json(message.payload)
    except ValidationError:
        axis, _, kind = message.topic.partition("/")
        said = f"an event of another version of the service: {kind}"
        return Event(
            axis=axis, kind="other", severity=Severity.WARNING, message=said, time_ns=now_ns()
        )


def check_email(settings: EmailConfig) -> None:
    """Check what only the file system knows. Raises ConfigError."""
    try:
        trusted(settings.ca_certificate)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"email.ca_certificate: {settings.ca_certificate}: cannot be used ({error})"
        ) from None


async def open_email(
    config: EdgeConfig, on_change: Callable[[str], None], answers: Answers
) -> Email | None:
    """The e-mails as configured; None without a `host`. Raises ConfigError."""
    settings = config.email
    if settings.host is None:
        return None
    check_email(settings)
    machine = f"{config.service.site}/{config.service.machine}"
    return Email(settings, machine, await open_spool(settings, "email"), answers, on_change)
