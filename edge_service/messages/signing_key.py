"""Key that a secret of Standard Webhooks stands for."""

import base64
import binascii

PREFIX = "whsec_"


def signing_key(secret: str) -> bytes:
    """Bytes to sign with: of `whsec_...` what its base64 holds, of any other text its own.

    Raises:
        ValueError: what follows `whsec_` is not base64 of 24 to 64 bytes.
    """
    if not secret.startswith(PREFIX):
        return secret.encode()
    try:
        key = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
    except binascii.Error:
        key = b""
    if not 24 <= len(key) <= 64:
        raise ValueError(f"expected base64 of 24 to 64 bytes after {PREFIX}")
    return key
