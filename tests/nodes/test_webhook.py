"""Events to another system: signed, in order, tried again, and never in the way."""

import asyncio
import hashlib
import hmac
import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import ClassVar

import pytest

from edge_service.config import ConfigError, EdgeConfig
from edge_service.messages.event import Event, Severity
from edge_service.nodes.outputs import webhook as webhook_module
from edge_service.nodes.outputs.webhook import SIGNATURE, TIMESTAMP, Webhook

from .conftest import config_of, heart, until

SECRET = b"a secret of some length"


class Receiver(BaseHTTPRequestHandler):
    """Answers with the statuses it was told, then with 204; keeps what it was sent."""

    statuses: ClassVar[list[int]] = []
    taken: ClassVar[list[tuple[dict[str, str], bytes]]] = []

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        self.taken.append((dict(self.headers), body))
        self.send_response(self.statuses.pop(0) if self.statuses else 204)
        self.send_header("content-length", "0")
        self.end_headers()

    def log_message(self, *_args: object) -> None:
        """Say nothing."""


@pytest.fixture
def url() -> Iterator[str]:
    Receiver.statuses.clear()
    Receiver.taken.clear()
    server = HTTPServer(("127.0.0.1", 0), Receiver)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


def _event(number: int, kind: str = "alarm_raised") -> Event:
    return Event(axis="X", kind=kind, severity=Severity.ERROR, message=str(number), time_ns=number)


async def _send(webhook: Webhook, numbers: range) -> None:
    task = asyncio.create_task(webhook.run(heart()))
    for number in numbers:
        webhook.put(_event(number))

    async def over() -> bool:
        return webhook.sent + webhook.refused == len(numbers)

    await until(over)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_events_arrive_in_order_and_signed(url):
    webhook = Webhook(url, SECRET, ("alarm_raised",))
    webhook.put(_event(9, "note"))
    await _send(webhook, range(3))
    assert [json.loads(body)["message"] for _, body in Receiver.taken] == ["0", "1", "2"]
    headers, body = Receiver.taken[0]
    signed = f"{headers[TIMESTAMP]}.".encode() + body
    expected = hmac.new(SECRET, signed, hashlib.sha256).hexdigest()
    assert headers[SIGNATURE] == f"sha256={expected}"


async def test_it_is_tried_again_with_growing_pauses_until_it_arrives(url):
    Receiver.statuses.extend([500, 503, 429])
    pauses: list[float] = []

    async def sleep(seconds: float) -> None:
        pauses.append(seconds)

    await _send(Webhook(url, SECRET, ("alarm_raised",), sleep), range(2))
    assert pauses == [1.0, 2.0, 4.0]
    messages = [json.loads(body)["message"] for _, body in Receiver.taken]
    assert messages == ["0", "0", "0", "0", "1"]


async def test_a_refusal_is_not_repeated_and_holds_up_nothing(url):
    Receiver.statuses.append(400)
    webhook = Webhook(url, SECRET, ("alarm_raised",))
    await _send(webhook, range(2))
    assert (webhook.refused, webhook.sent) == (1, 1)


async def test_while_nobody_answers_the_newest_wait_and_the_oldest_go(monkeypatch):
    monkeypatch.setattr(webhook_module, "MOST_WAITING", 3)
    webhook = Webhook("http://127.0.0.1:9/", SECRET, ("alarm_raised",))
    monkeypatch.setattr(webhook, "_waiting", type(webhook._waiting)(maxlen=3))
    for number in range(5):
        webhook.put(_event(number))
    assert [event.message for event in webhook._waiting] == ["2", "3", "4"]
    assert webhook.dropped == 2


def test_without_a_url_nothing_waits():
    webhook = Webhook.of(config_of("simulated", {}))
    webhook.put(_event(1))
    assert not webhook._waiting


@pytest.mark.parametrize("content", [None, b"short"])
def test_a_secret_that_cannot_sign_is_told(tmp_path, content):
    path = tmp_path / "secret"
    if content is not None:
        path.write_bytes(content)
    config = EdgeConfig.model_validate(
        {
            "axes": [{"name": "X"}],
            "webhook": {"url": "http://127.0.0.1/", "secret_file": str(path)},
        }
    )
    with pytest.raises(ConfigError, match=r"webhook\.secret_file"):
        Webhook.of(config)
