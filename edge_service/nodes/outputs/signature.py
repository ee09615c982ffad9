"""Signatures of what a webhook sends: by Standard Webhooks 1.0.0, and the headers from before it.

Source: https://github.com/standard-webhooks/standard-webhooks, `spec/standard-webhooks.md`.
"""

import base64
import hashlib
import hmac
from collections.abc import Sequence

from ...messages.signing_key import signing_key

SIGNATURE = "X-Edge-Signature"
TIMESTAMP = "X-Edge-Timestamp"
DELIVERY = "X-Edge-Delivery"


def sign(secret: bytes, timestamp: str, body: bytes) -> str:
    """`sha256=` and the HMAC-SHA256 of `{timestamp}.{body}` in hex."""
    return "sha256=" + hmac.new(secret, f"{timestamp}.".encode() + body, hashlib.sha256).hexdigest()


def standard_sign(key: bytes, message_id: str, timestamp: str, body: bytes) -> str:
    """`v1,` and the HMAC-SHA256 of `{message_id}.{timestamp}.{body}` in base64."""
    signed = f"{message_id}.{timestamp}.".encode() + body
    return "v1," + base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()


def signed_headers(
    secrets: Sequence[str], message_id: str, timestamp: str, body: bytes
) -> dict[str, str]:
    """Headers of one event, a standard signature by each secret.

    Args:
        secrets: the newest first, which alone makes the signature from before the standard.
        message_id: the same each time that the event is sent.
        timestamp: of this try, s since 1970.
    """
    signatures = [standard_sign(signing_key(each), message_id, timestamp, body) for each in secrets]
    return {
        "webhook-id": message_id,
        "webhook-timestamp": timestamp,
        "webhook-signature": " ".join(signatures),
        DELIVERY: message_id,
        TIMESTAMP: timestamp,
        SIGNATURE: sign(secrets[0].encode(), timestamp, body),
    }
