"""Words of letters, those of the page, in the language that is configured."""

from datetime import datetime

from ....http_api.words import words_in
from ....messages.advice import Level
from ....messages.answer import AxisAnswer
from ....messages.event import Event
from ....messages.printed import printed
from ....messages.sentence import Sentence, Value


class Words:
    """Words of one language."""

    def __init__(self, language: str) -> None:
        self._is_english = language == "en"
        self._known = words_in(language)

    def __call__(self, key: str, **values: object) -> str:
        """Text of a key, with its values put in."""
        text = self._known[key]
        for name, value in values.items():
            text = text.replace(f"{{{name}}}", str(value))
        return text

    def counted(self, key: str, n: int) -> str:
        """Text that a number asks for."""
        return self(f"{key}.{'one' if n == 1 else 'other'}", n=n)

    def moment(self, time_ns: int) -> str:
        """Date and time here, with the zone."""
        return datetime.fromtimestamp(time_ns / 1e9).astimezone().strftime(self("mail.moment"))

    def headline(self, event: Event, answer: AxisAnswer | None) -> str:
        """Headline of the axis as it is known now, else of the event, else what that says."""
        now = None if answer is None else answer.health.headline
        is_known = now is not None and now.level is not Level.UNKNOWN
        code = now.code if now and is_known else event.data.get("headline")
        return self._known.get(f"headline.{code}", event.message)

    def event(self, event: Event) -> str:
        """Sentence about an event."""
        word = self._known.get(f"alarm.{event.data.get('alarm')}")
        told, note = self.said(event.sentence, event.message), event.data.get("note")
        if note and told != event.message:
            told = f"{told}: {note}"
        said = " ".join(told.split())
        return said if word is None else f"{word} ({said})"

    def said(self, sentence: Sentence | None, message: str) -> str:
        """Sentence of the service; its English message where there are no other words for it."""
        text = None if sentence is None else self._known.get(f"said.{sentence.code}")
        if self._is_english or sentence is None or text is None:
            return message
        shown = {name: self._value(name, value) for name, value in sentence.values.items()}
        return self(f"said.{sentence.code}", **shown)

    def _value(self, name: str, value: Value) -> str:
        """A number, the word for a code, or a name."""
        if isinstance(value, str):
            return self._known.get(f"{name}.{value}", value)
        return f"{value:.6g}".replace(".", self("mail.decimal"))

    def state(self, answer: AxisAnswer | None) -> str:
        """Preload now and how sure it is, or that it is not known."""
        interval = None if answer is None else answer.of_fresh
        if answer is None or interval is None:
            return self("headline.unavailable")
        value, low, high = printed(interval.value, interval.low, interval.high)
        bounds = self("between", low=low, high=high)
        sure = self("answer.unsure")
        if answer.estimate.level is not None:
            sure = self("answer.sure", level=f"{100.0 * answer.estimate.level:.0f}", bounds=bounds)
        return f"{self('of_fresh', n=value)}, {sure}"

    def tasks(self, answer: AxisAnswer | None) -> list[str]:
        """Tasks in words, the most urgent first, each with its date and what goes with it."""
        told = []
        for each in () if answer is None else answer.health.advice:
            parts = [self._known.get(f"task.{each.task}", each.text)]
            if each.due is not None:
                parts.append(self("task.due", first=self.moment(each.due.earliest_ns)))
            parts += [self._known.get(f"together.{more}", "") for more in each.together_with]
            told.append(" ".join(part for part in parts if part))
        return told
