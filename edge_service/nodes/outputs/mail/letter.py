"""Letter about events: what happened, how sure that is, what to do and until when.

Formats: RFC 5322 (letters), RFC 3834 (`Auto-Submitted`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from email.message import EmailMessage
from email.policy import SMTP
from email.utils import format_datetime
from hashlib import sha256
from html import escape
from urllib.parse import quote

from ....messages.answer import AxisAnswer
from ....messages.event import Event, Severity
from .words import Words

MOST_TOLD = 20
"""Events of an axis that a letter tells one by one; the others are counted."""
_GRAVITY = list(Severity)
_STYLE = "font-family:sans-serif;max-width:40em"


@dataclass(frozen=True, slots=True)
class Envelope:
    """Facts that all letters of a service share.

    Attributes:
        machine: `{site}/{machine}`.
        sender, recipients: addresses.
        page_url: of the page, for links; empty without.
        language: of the letters.
    """

    machine: str
    sender: str
    recipients: tuple[str, ...]
    page_url: str
    language: str


@dataclass(frozen=True, slots=True)
class Section:
    """Title, lines below it, and where they lead."""

    title: str
    lines: tuple[str, ...]
    link: str = ""


def letter(
    envelope: Envelope,
    events: Sequence[Event],
    keys: Sequence[str],
    answers: dict[str, AxisAnswer | None],
    now_ns: int,
) -> bytes:
    """One letter about some events.

    Args:
        events: in their order, at least one.
        keys: names of the events for ever; they make the letter's own name.
        answers: what holds now of each axis that is concerned.
        now_ns: UNIX time, ns.
    """
    words = Words(envelope.language)
    message = EmailMessage(policy=SMTP)
    message["From"] = envelope.sender
    message["To"] = ", ".join(envelope.recipients)
    message["Subject"] = _subject(envelope, events, answers, words)
    message["Date"] = format_datetime(datetime.fromtimestamp(now_ns / 1e9, UTC))
    message["Message-ID"] = message_id(keys, envelope.sender)
    message["Auto-Submitted"] = "auto-generated"
    sections = _sections(envelope, events, answers, words, now_ns)
    message.set_content(_text(sections, words), cte="quoted-printable")
    message.add_alternative(_html(sections, words), subtype="html", cte="quoted-printable")
    message["Content-Language"] = envelope.language
    return message.as_bytes()


def message_id(keys: Sequence[str], sender: str) -> str:
    """Name of a letter: the same whenever it is about the same events."""
    digest = sha256("\n".join(keys).encode()).hexdigest()[:32]
    return f"<{digest}@{sender.rpartition('@')[2]}>"


def _subject(
    envelope: Envelope,
    events: Sequence[Event],
    answers: dict[str, AxisAnswer | None],
    words: Words,
) -> str:
    worst = max(events, key=lambda event: _GRAVITY.index(event.severity))
    about = words.headline(worst, answers.get(worst.axis))
    place = words("mail.about", machine=envelope.machine, axis=worst.axis)
    subject = f"{place if worst.axis else envelope.machine}: {about}"
    others = {event.axis for event in events} - {worst.axis}
    if others:
        subject += f" ({words.counted('mail.others', len(others))})"
    return " ".join(subject.split())[:200]


def _sections(
    envelope: Envelope,
    events: Sequence[Event],
    answers: dict[str, AxisAnswer | None],
    words: Words,
    now_ns: int,
) -> list[Section]:
    """A section of each axis, the gravest first."""
    axes = dict.fromkeys(
        event.axis for event in sorted(events, key=lambda each: -_GRAVITY.index(each.severity))
    )
    return [
        _section(
            envelope,
            [event for event in events if event.axis == axis],
            answers.get(axis),
            words,
            now_ns,
        )
        for axis in axes
    ]


def _section(
    envelope: Envelope,
    events: Sequence[Event],
    answer: AxisAnswer | None,
    words: Words,
    now_ns: int,
) -> Section:
    axis = events[0].axis
    worst = max(events, key=lambda event: _GRAVITY.index(event.severity))
    lines = [f"{words.moment(each.time_ns)}: {words.event(each)}" for each in events[-MOST_TOLD:]]
    if len(events) > MOST_TOLD:
        lines.insert(0, words.counted("mail.earlier", len(events) - MOST_TOLD))
    if axis:
        lines.append(words("mail.state", time=words.moment(now_ns), state=words.state(answer)))
        lines += [f"{words('answer.todo')}: {task}" for task in words.tasks(answer)]
    place = f"{words('mail.axis', axis=axis)}: " if axis else ""
    link = envelope.page_url and f"{envelope.page_url.rstrip('/')}/#/{quote(axis)}"
    return Section(f"{place}{words.headline(worst, answer)}", tuple(lines), link)


def _text(sections: Sequence[Section], words: Words) -> str:
    parts = [
        "\n".join(
            [each.title, *(f"  {line}" for line in each.lines), *([each.link] * bool(each.link))]
        )
        for each in sections
    ]
    return "\n\n".join([*parts, f"-- \n{words('mail.end')}"]) + "\n"


def _html(sections: Sequence[Section], words: Words) -> str:
    parts = [_html_section(each, words) for each in sections]
    end = f'<p style="color:#666">{escape(words("mail.end"))}</p>'
    lang = escape(words("mail.code"), quote=True)
    body = f'<body style="{_STYLE}">{"".join(parts)}{end}</body>'
    return f'<!doctype html><html lang="{lang}">{body}</html>\n'


def _html_section(section: Section, words: Words) -> str:
    lines = "\n".join(f"<li>{escape(line)}</li>" for line in section.lines)
    href = escape(section.link, quote=True)
    link = f'<p><a href="{href}">{escape(words("mail.page"))}</a></p>' if href else ""
    return f"<h2>{escape(section.title)}</h2>\n<ul>\n{lines}\n</ul>\n{link}\n"
