"""The library's errors, translated once."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from asyncua.ua.status_codes import StatusCodes, get_name_and_doc
from asyncua.ua.uaerrors import (
    BadBrowseNameInvalid,
    BadNodeIdInvalid,
    BadNodeIdUnknown,
    BadNoMatch,
    UaError,
    UaStatusCodeError,
    UaStringParsingError,
)

from ..base import DriverMisconfiguredError, DriverUnavailableError

FAILURES = (OSError, TimeoutError, UaError)
"""Errors raised by the library when communication with a server fails, or the server refuses."""
NOT_THERE = (
    BadBrowseNameInvalid,
    BadNoMatch,
    BadNodeIdInvalid,
    BadNodeIdUnknown,
    UaStringParsingError,
    ValueError,
)
"""Errors raised for a variable that the server does not have, or for an invalid name."""
_REFUSED = {
    StatusCodes.BadUserAccessDenied: "user",
    StatusCodes.BadIdentityTokenRejected: "user",
    StatusCodes.BadIdentityTokenInvalid: "user",
    StatusCodes.BadSecurityChecksFailed: "certificate",
    StatusCodes.BadCertificateUntrusted: "certificate",
    StatusCodes.BadCertificateInvalid: "certificate",
    StatusCodes.BadCertificateTimeInvalid: "certificate",
    StatusCodes.BadCertificateUriInvalid: "application_uri",
    StatusCodes.BadSecurityPolicyRejected: "security_policy",
    StatusCodes.BadSecurityModeRejected: "security_mode",
}
"""A refusal that trying again does not change -> the key to look at."""


@asynccontextmanager
async def translated(url: str) -> AsyncIterator[None]:
    """Every failure inside becomes one of the two driver errors."""
    try:
        yield
    except FAILURES as error:
        key = _REFUSED.get(error.code) if isinstance(error, UaStatusCodeError) else None
        if key is not None:
            raise DriverMisconfiguredError(key, f"{url}: refused, {say(error)}") from None
        raise DriverUnavailableError(f"{url}: {say(error)}") from None


def say(error: Exception) -> str:
    """An error in a few words."""
    if isinstance(error, UaStatusCodeError):
        return str(get_name_and_doc(error.code)[0])
    if isinstance(error, TimeoutError):
        return "no answer in time"
    return str(error) or type(error).__name__
