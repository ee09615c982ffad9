"""Messages to people by apprise: mail, webhook, ntfy, Teams and whatever else has a URL there."""

import logging
import re
import threading
from collections.abc import Mapping, Sequence
from datetime import datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import apprise
from pydantic import Field

from ..messages.event import AxisCondition, Event, Statement
from ..plugins import MisconfiguredError
from ..secret_files import SecretError, read_secret
from ..threads import Threads
from .base import (
    Events,
    Message,
    Output,
    OutputConfig,
    OutputContext,
    OutputUnavailableError,
    RefusedError,
)

MOST_TOLD = 20
"""Events that a letter tells one by one; the others are counted."""
_SENDERS = Threads("notify", 4)
_REASON = re.compile(r"\berror=(\d{3})\b")
_LATER = (408, 425, 429)
_TAKEN_AS = {AxisCondition.UNAVAILABLE: AxisCondition.WARNING}
"""Levels that count as another one: data that are missing are not to be missed."""
_KINDS = {
    AxisCondition.NORMAL: apprise.NotifyType.INFO,
    AxisCondition.WARNING: apprise.NotifyType.WARNING,
    AxisCondition.FAULT: apprise.NotifyType.FAILURE,
}
_ASSET = apprise.AppriseAsset(app_id="edge-service", app_desc="", app_url="")
_LOG = logging.getLogger("apprise")
for _each in (_LOG, logging.getLogger("urllib3")):  # they write addresses, which may be secrets
    _each.propagate = False
    _each.setLevel(logging.WARNING)
    _each.addHandler(logging.NullHandler())


class _Status(logging.Handler):
    """Status with which a receiver answered, from apprise's words in this thread."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._thread = threading.get_ident()
        self.code: int | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Keep the number, and nothing else of what may hold secrets."""
        found = _REASON.search(record.getMessage())
        if found is not None and record.thread == self._thread:
            self.code = int(found[1])


class NotifyConfig(OutputConfig):
    urls_file: Path  # a URL of apprise a line, for its owner alone, as it may hold secrets
    # kinds of the events that are told
    events: tuple[str, ...] = Field(("alarm_raised", "alarm_cleared"), min_length=1)
    level: Literal["NORMAL", "WARNING", "FAULT"] = "WARNING"  # the least that is told
    language: Literal["en", "de"] = "en"


class NotifyOutput(Output):
    """Letters about the events of half a minute, at most twelve an hour, to each URL by itself."""

    config_model = NotifyConfig
    takes_answers = False
    gather_s = 30.0
    most_per_hour = 12

    def __init__(self, config: NotifyConfig, context: OutputContext) -> None:
        super().__init__(config, context)
        self._services: dict[str, Any] = {}
        self._is_open = False
        self._words = context.words(config.language)
        file = config.urls_file
        try:
            lines = [line.strip() for line in read_secret(file).splitlines()]
        except SecretError as error:
            raise MisconfiguredError("urls_file", str(error)) from None
        for number, url in enumerate(lines, 1):
            if not url or url.startswith("#"):
                continue
            service = apprise.Apprise.instantiate(url, asset=_ASSET)
            if service is None:
                problem = f"{file}: line {number} is no URL of apprise"
                raise MisconfiguredError("urls_file", problem)
            scheme = re.sub(r"[^a-z0-9]", "", url.partition(":")[0].lower())
            self._services[f"{scheme}-{sha256(url.encode()).hexdigest()[:6]}"] = service
        if not self._services:
            raise MisconfiguredError("urls_file", f"{file}: holds no URL")
        self.receivers = tuple(self._services)

    @property
    def kinds(self) -> frozenset[str]:
        return frozenset(self.config.events)

    async def open(self) -> None:
        self._is_open = True

    async def take(self, message: Message) -> None:
        """Send a letter to one receiver; nothing where all events are below the level."""
        if not self._is_open:
            raise OutputUnavailableError("not open")
        assert isinstance(message, Events)
        least = AxisCondition(self.config.level).urgency
        told = [each for each in message.events if _level(each).urgency >= least]
        if told:
            await _SENDERS.run(self._send, message.receiver, told)

    async def close(self) -> None:
        self._is_open = False

    def _send(self, receiver: str, events: Sequence[Event]) -> None:
        gravest = max(map(_level, events), key=lambda level: level.urgency)
        title, body = self.letter(events)
        said, service = _Status(), self._services[receiver]
        _LOG.addHandler(said)
        try:
            taken = service.notify(body=body, title=title, notify_type=_KINDS[gravest])
        finally:
            _LOG.removeHandler(said)
        code = said.code
        if taken:
            return
        if code is not None and 400 <= code < 500 and code not in _LATER:
            raise RefusedError(f"{receiver}: answered {code}")
        answered = "cannot be reached" if code is None else f"answered {code}"
        raise OutputUnavailableError(f"{receiver}: {answered}")

    def letter(self, events: Sequence[Event]) -> tuple[str, str]:
        """Title and text about some events, at least one."""
        machine = f"{self.context.site}/{self.context.machine}"
        sentences = [self._said(event) for event in events]
        axes = dict.fromkeys(event.axis for event in events if event.axis)
        more = f" (+{len(events) - 1})" if len(events) > 1 else ""
        title = f"{machine} {' '.join(axes)}: {sentences[0]}{more}"
        lines = [
            f"{datetime.fromtimestamp(event.time_ns / 1e9).astimezone():%Y-%m-%d %H:%M:%S %Z}"
            f" {event.axis}: {said}"
            for event, said in zip(events, sentences, strict=True)
        ]
        if len(lines) > MOST_TOLD:
            lines[MOST_TOLD:] = [f"... +{len(lines) - MOST_TOLD}"]
        lines += filter(None, [self.context.page])
        return " ".join(title.split()), "\n".join(lines)

    def _said(self, event: Event) -> str:
        """Sentence about an event, in the language of the letters as far as there are words."""
        words, told = self._words, event.text
        if self.config.language != "en" and event.code:
            told = sentence_in(words, event) or told
        alarm = words.get(f"alarm.{event.data.get('alarm')}")
        return f"{alarm}: {told}" if alarm and event.kind == "alarm_raised" else told


def _level(event: Event) -> AxisCondition:
    return _TAKEN_AS.get(event.level, event.level)


def sentence_in(words: Mapping[str, str], said: Statement) -> str | None:
    """A statement of the service in the words of the page; None where it has none for it."""
    text = words.get(f"said.{said.code}")
    for name, value in said.values.items() if text is not None else ():
        if name in ("time", "since", "until"):
            shown = f"{datetime.fromisoformat(str(value)).astimezone():%Y-%m-%d %H:%M:%S}"
        elif isinstance(value, str):
            shown = words.get(f"{name}.{value}", value)
        else:
            shown = f"{value:.6g}".replace(".", words["mail.decimal"])
        text = (text or "").replace(f"{{{name}}}", shown)
    return text
