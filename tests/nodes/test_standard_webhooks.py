"""Signatures of events by Standard Webhooks: its own library and its published example agree."""

import base64
import random
from pathlib import Path

import pytest
import standardwebhooks as library
from pydantic import SecretStr, ValidationError

from edge_service.bus.spool.spool import Spool
from edge_service.config_tables import WebhookConfig
from edge_service.health.events.log import LoggedEvent
from edge_service.messages.event import Event, Severity
from edge_service.messages.signing_key import PREFIX, signing_key
from edge_service.nodes.outputs import post
from edge_service.nodes.outputs.signature import signed_headers, standard_sign
from edge_service.nodes.outputs.webhook import Webhook

from .conftest import heart

SEEDS = range(20)


def _secret(dice: random.Random) -> str:
    """A `whsec_` of any length that the standard allows."""
    return PREFIX + base64.b64encode(dice.randbytes(dice.randint(24, 64))).decode()


def test_the_example_of_the_standard_has_its_signature() -> None:
    """From the tests of the standard's own libraries."""
    key = signing_key("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw")
    body = b'{"test": 2432232314}'
    made = standard_sign(key, "msg_p5jXN8AQM9LWM0D4loKWxJek", "1614265330", body)
    assert made == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


@pytest.mark.parametrize("seed", SEEDS)
async def test_the_library_of_the_standard_accepts_what_is_sent_by_old_and_new_secret(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dice = random.Random(seed)
    new, old, foreign = _secret(dice), _secret(dice), _secret(dice)
    sent: list[tuple[bytes, dict[str, str]]] = []

    async def keep(_poster: post.Poster, body: bytes, headers: dict[str, str]) -> post.Reply:
        sent.append((body, headers))
        return post.Reply(post.Outcome.TAKEN)

    monkeypatch.setattr(post.Poster, "post", keep)
    settings = WebhookConfig(
        url=SecretStr("http://127.0.0.1:9/"),
        secret=SecretStr(new),
        previous_secret=SecretStr(old),
    )
    spool = await Spool.open(tmp_path / "spool.sqlite", 10)
    webhook = Webhook(settings, spool)
    said = "".join(chr(dice.randint(32, 0x2FFF)) for _ in range(50))
    event = Event(axis="X", kind="alarm_raised", severity=Severity.ERROR, message=said, time_ns=1)
    webhook.put(LoggedEvent(1, event))
    await webhook._round(heart())
    spool.close()
    ((body, headers),) = sent
    for secret in (new, old):
        assert library.Webhook(secret).verify(body, headers)["message"] == said
    refused = library.WebhookVerificationError
    with pytest.raises(refused):
        library.Webhook(foreign).verify(body, headers)
    with pytest.raises(refused):
        library.Webhook(new).verify(body + b" ", headers)
    with pytest.raises(refused):
        library.Webhook(new).verify(body, headers | {"webhook-id": "another"})


def test_with_one_secret_there_is_one_signature() -> None:
    headers = signed_headers(["a secret of some length"], "1", "1700000000", b"{}")
    assert headers["webhook-signature"].count("v1,") == 1


@pytest.mark.parametrize("key", ["secret", "previous_secret"])
@pytest.mark.parametrize(
    "value",
    [
        "whsec_",
        "whsec_no base64 but quite long enough",
        PREFIX + base64.b64encode(bytes(23)).decode(),
        PREFIX + base64.b64encode(bytes(65)).decode(),
    ],
)
def test_a_whsec_that_the_standard_does_not_allow_is_refused_unseen(key: str, value: str) -> None:
    with pytest.raises(ValidationError, match="expected base64 of 24 to 64 bytes") as caught:
        WebhookConfig.model_validate({key: value})
    assert value.removeprefix(PREFIX)[:20] not in str(caught.value) or value == PREFIX
