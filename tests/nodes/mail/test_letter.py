"""What letters say: what happened, how sure, what to do, until when; and nothing else gets in."""

import random
from datetime import UTC, datetime
from email import message_from_bytes
from email.message import EmailMessage
from email.policy import default
from html.parser import HTMLParser

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from edge_service.clock import now_ns
from edge_service.config import HealthConfig
from edge_service.config_tables import EmailConfig
from edge_service.health.advice.consistent import consistent
from edge_service.health.service_state import ServiceState
from edge_service.health.settings import HealthSettings
from edge_service.messages.advice import Advice, Due, Subject, Task
from edge_service.messages.alarm import Alarm, AlarmKind
from edge_service.messages.answer import AxisAnswer
from edge_service.messages.estimate import EstimateStatus, PreloadEstimate
from edge_service.messages.event import Event, Severity
from edge_service.messages.header import Header
from edge_service.messages.health import AxisCondition, AxisHealth
from edge_service.nodes.outputs.latest_answers import answer_of
from edge_service.nodes.outputs.mail.letter import Envelope, letter

NOW_NS = 1_795_000_000_000_000_000
DAY_NS = 86_400_000_000_000
HEADERS = {
    *("From", "To", "Subject", "Date", "Message-ID", "Auto-Submitted", "Content-Language"),
    *("MIME-Version", "Content-Type"),
}


class _Text(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.said, self.tags = "", set[str]()

    def handle_data(self, data: str) -> None:
        self.said += data

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.add(tag)


def written(
    *events: Event, language: str = "en", page_url: str = "", **answers: AxisAnswer
) -> tuple[EmailMessage, str, _Text]:
    """A letter as a foreign reader takes it apart: the whole, its text, its HTML."""
    people = ("edge@example.org", ("one@example.org", "two@example.org"))
    envelope = Envelope("hall/mill", *people, page_url, language)
    keys = [str(number) for number, _ in enumerate(events)]
    content = letter(envelope, events, keys, dict(answers), NOW_NS)
    assert max(len(line) for line in content.split(b"\r\n")) <= 998
    message = message_from_bytes(content, policy=default)
    assert isinstance(message, EmailMessage)
    assert message.defects == []
    html = _Text()
    html.feed(message.get_body(("html",)).get_content())
    return message, message.get_body(("plain",)).get_content(), html


def alarm(axis: str = "X", said: str = "preload at 27 % of the fresh screw's; limit 30 %") -> Event:
    return Event(
        axis=axis,
        kind="alarm_raised",
        severity=Severity.ERROR,
        message=said,
        time_ns=NOW_NS - 30_000_000_000,
        data={"alarm": "preload_lost", "headline": "preload_lost"},
    )


def answer(status: EstimateStatus = EstimateStatus.ESTIMATED) -> AxisAnswer:
    known = status is EstimateStatus.ESTIMATED
    numbers = {"preload_percent": 1.85, "low": 1.64, "high": 2.1, "level": 0.95} if known else {}
    estimate = PreloadEstimate(time_s=0.0, status=status, **numbers)
    task = Advice(
        task=Task.REPLACE_NUT,
        subject=Subject.PRELOAD,
        text="Replace the nut.",
        now=False,
        due=Due(earliest_ns=NOW_NS + 3 * DAY_NS),
        together_with=(Task.REGREASE,),
    )
    lost = Alarm(
        kind=AlarmKind.PRELOAD_LOST,
        severity=Severity.ERROR,
        active=True,
        message="preload lost",
        raised_time_ns=NOW_NS,
    )
    health = AxisHealth(
        axis="X",
        condition=AxisCondition.FAULT,
        since_time_ns=NOW_NS,
        alarms=(lost,),
    )
    health = consistent(health, estimate).model_copy(update={"advice": (task,)})
    return AxisAnswer("X", estimate, NOW_NS, health, 6.85, 60.0, 30.0, True)


@pytest.mark.parametrize(
    ("language", "subject", "sure", "task"),
    [
        (
            "en",
            "hall/mill, axis X: The preload is lost, or nearly so.",
            "27 % of fresh, 95 % sure: 23 to 31 %",
            "What to do: Replace or readjust the nut",
        ),
        (
            "de",
            "hall/mill, Achse X: Die Vorspannung ist ganz oder fast verloren.",
            "27 % von neu, zu 95 % sicher: 23 bis 31 %",
            "Was zu tun ist: ",
        ),
    ],
)
def test_a_letter_says_what_how_sure_what_to_do_and_until_when(
    language: str, subject: str, sure: str, task: str
) -> None:
    message, text, html = written(
        alarm(), language=language, page_url="https://edge-box:8080/", X=answer()
    )
    assert message["Subject"].strip() == subject
    assert message["Content-Language"] == language
    due = datetime.fromtimestamp((NOW_NS + 3 * DAY_NS) / 1e9, UTC).astimezone()
    for part in (text, html.said):
        assert "preload at 27 %" in part
        assert sure in part
        assert task in part
        assert due.strftime("%Y-%m-%d" if language == "en" else "%d.%m.%Y") in part
    assert "https://edge-box:8080/#/X" in text
    assert message["Date"].datetime == datetime.fromtimestamp(NOW_NS / 1e9, UTC)


def test_a_letter_tells_what_the_service_knows_when_it_is_written() -> None:
    limits = HealthSettings().limits(5.0)
    state = ServiceState({"X": limits, "Y": limits}, now_ns())
    estimate = PreloadEstimate(
        time_s=1.0, status=EstimateStatus.ESTIMATED, preload_percent=3.0, low=2.5, high=4.0
    )
    state.on_preload("X", Header(1, 1, now_ns(), 1), estimate, now_ns())
    held = {axis: answer_of(state, HealthConfig(), axis) for axis in ("X", "Y", "Z")}
    assert held["Z"] is None
    _, text, _ = written(alarm("X"), alarm("Y"), alarm("Z"), **held)
    assert text.count("60 % of fresh, 95 % sure: 50 to 80 %") == 1
    assert text.count("not known at present") == 2


@pytest.mark.parametrize("status", [each for each in EstimateStatus if each != "estimated"])
def test_no_number_is_told_where_there_is_none(status: EstimateStatus) -> None:
    _, text, _ = written(alarm(said="gone"), X=answer(status))
    assert "not known at present" in text
    assert "% of fresh," not in text


def test_several_axes_stand_below_one_another_the_gravest_first() -> None:
    mild = alarm("Y", "low").model_copy(update={"severity": Severity.WARNING})
    message, text, _ = written(mild, alarm("X"))
    assert message["Subject"].strip().startswith("hall/mill, axis X: ")
    assert message["Subject"].endswith("(and 1 more axis)")
    assert text.index("Axis X") < text.index("Axis Y")


@given(st.text(), st.text(min_size=1))
def test_nothing_that_an_event_says_becomes_a_header_a_recipient_or_a_tag(
    said: str, code: str
) -> None:
    attacks = (
        "\r\nBcc: thief@example.org",
        "\n\n<script>",
        "\r.\r\n",
        "<img src=x>",
        "\x00",
        "\udcff",
    )
    for attack in attacks:
        event = alarm(said=(said + attack).encode("utf-8", "replace").decode())
        event = event.model_copy(update={"data": {"headline": code, "alarm": code}})
        message, _, html = written(event)
        assert set(message.keys()) <= HEADERS
        assert len(message.get_all("To")) == 1
        assert [str(each) for each in message["To"].addresses] == [
            "one@example.org",
            "two@example.org",
        ]
        assert html.tags <= {"html", "body", "h2", "ul", "li", "p", "a"}


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"sender": "edge@example.org\r\nBcc: a@b"}, "sender"),
        ({"recipients": ["one@example.org, two@example.org"]}, "recipients"),
        ({"recipients": ["<one@example.org>"]}, "recipients"),
        ({"recipients": []}, "recipients: missing"),
        ({"sender": ""}, "sender: missing"),
        ({"security": "plain"}, "needs allow_plain"),
        ({"user": "edge"}, "password_file: missing"),
        ({"page_url": "javascript:alert(1)"}, "page_url"),
        ({"language": "fr"}, "language"),
        ({"severities": ["grave"]}, "severities"),
    ],
)
def test_what_makes_no_letter_is_refused(changes: dict[str, object], complaint: str) -> None:
    right = {"host": "mail.example.org", "sender": "a@example.org", "recipients": ["b@example.org"]}
    EmailConfig.model_validate(right)
    with pytest.raises(ValidationError, match=complaint):
        EmailConfig.model_validate(right | changes)


def test_addresses_of_random_letters_never_break_a_header() -> None:
    dice = random.Random(7)
    for _ in range(2000):
        name = "".join(chr(dice.randrange(1, 300)) for _ in range(4))
        try:
            EmailConfig(host="h", sender=f"{name}@example.org", recipients=("b@example.org",))
        except ValidationError:
            continue
        envelope = Envelope("hall/mill", f"{name}@example.org", ("b@example.org",), "", "en")
        message = message_from_bytes(letter(envelope, [alarm()], ["0"], {}, NOW_NS), policy=default)
        assert message["From"].addresses[0].addr_spec == f"{name}@example.org"
