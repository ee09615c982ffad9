"""A test message by each output of events: taken or not, and why."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP, Envelope, Session
from click.testing import CliRunner

from edge_service.cli.entry import cli
from edge_service.config import ConfigError, load_config
from edge_service.messages.outputs import OF_HTTP
from edge_service.nodes.outputs.trial import try_output

from ...drivers.bench import free_port
from ..receivers import receiving

AXIS = '[[axes]]\nname = "X"\n'
EMAIL = '[email]\nsecurity = "plain"\nhost = "127.0.0.1"\nport = {}\n'
PEOPLE = 'sender = "edge@example.org"\nrecipients = ["shift@example.org"]\n'


class _Handler:
    """Keeps letters, or refuses them."""

    def __init__(self) -> None:
        self.answer, self.letters = "250 taken", list[bytes]()

    async def handle_DATA(self, server: SMTP, session: Session, envelope: Envelope) -> str:
        self.letters.append(bytes(envelope.content or b""))
        return self.answer


@pytest.fixture
def mail() -> Iterator[tuple[_Handler, int]]:
    handler, port = _Handler(), free_port()
    controller = Controller(handler, hostname="127.0.0.1", port=port)
    controller.start()
    yield handler, port
    controller.stop(no_assert=True)


def configured(folder: Path, text: str) -> str:
    path = folder / "edge.toml"
    path.write_text(text + AXIS)
    path.chmod(0o600)
    return str(path)


def test_a_letter_that_is_taken_or_refused_is_told(
    tmp_path: Path, mail: tuple[_Handler, int]
) -> None:
    handler, port = mail
    path = configured(tmp_path, EMAIL.format(port) + PEOPLE)
    done = CliRunner().invoke(cli, ["send-test", "email", path], standalone_mode=False)
    assert (done.return_value, done.output) == (
        0,
        f"email: 127.0.0.1:{port} has taken a test message\n",
    )
    assert b"nothing has happened" in handler.letters[0]
    assert not (tmp_path / "email-buffer.sqlite").exists()
    handler.answer = "554 no"
    done = CliRunner().invoke(cli, ["send-test", "email", path], standalone_mode=False)
    assert (done.return_value, done.output) == (1, f"email: 127.0.0.1:{port}: answered 554\n")


def test_nobody_at_home_is_told(tmp_path: Path) -> None:
    path = configured(tmp_path, EMAIL.format(free_port()) + PEOPLE)
    done = CliRunner().invoke(cli, ["send-test", "email", path], standalone_mode=False)
    assert done.return_value == 1
    assert "cannot be reached" in done.output


@pytest.mark.parametrize("content", [None, "no certificate"])
def test_an_authority_that_cannot_be_used_is_told_before_anything_runs(
    content: str | None, tmp_path: Path
) -> None:
    if content is not None:
        (tmp_path / "ca.pem").write_text(content)
    text = EMAIL.format(25) + PEOPLE + 'ca_certificate = "ca.pem"\n'
    path = configured(tmp_path, text)
    for command in (["check-config", path], ["send-test", "email", path]):
        done = CliRunner().invoke(cli, command, standalone_mode=False)
        assert isinstance(done.exception, ConfigError)
        assert str(done.exception).startswith(f"email.ca_certificate: {tmp_path}/ca.pem: cannot")


async def test_a_webhook_is_tried_too(tmp_path: Path) -> None:
    async with receiving() as receiver:
        text = f'[webhook]\nurl = "{receiver.url}"\nsecret = "a secret of some length"\n'
        trial = await try_output(load_config(Path(configured(tmp_path, text))), "webhook")
        assert (trial.problem, len(receiver.taken)) == ("", 1)


@pytest.mark.parametrize("output", OF_HTTP)
def test_an_output_without_an_address_is_named(output: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        cli, ["send-test", output, configured(tmp_path, "")], standalone_mode=False
    )
    assert f"{output}: nothing can be sent" in str(done.exception)
