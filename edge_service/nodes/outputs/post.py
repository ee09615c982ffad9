"""One HTTP POST, and what its answer means: bounded in time and size, redirects not followed."""

import asyncio
import logging
import ssl
from collections.abc import Mapping

import httpx

from .reply import Outcome, Reply

for _name in ("httpx", "httpcore"):
    logging.getLogger(_name).setLevel(logging.CRITICAL)  # they would write whole addresses
CONNECT_S = 5.0
WHOLE_S = 15.0
"""Time for a whole exchange, however slowly bytes come."""
_LATER = frozenset({408, 425, 429, 502, 503, 504})
_NEVER = frozenset({400, 413, 415, 422})


class Poster:
    """Posts to one address. Nothing is kept from one post to the next."""

    def __init__(self, url: str) -> None:
        self._url = httpx.URL(url)
        self._tls = ssl.create_default_context()

    @property
    def place(self) -> str:
        """Address without what only the receiver should know."""
        return f"{self._url.scheme}://{self._url.netloc.decode()}"

    async def post(self, body: bytes, headers: Mapping[str, str]) -> Reply:
        """Post once; whatever the other side does ends in a reply."""
        (reply,) = await asyncio.gather(self._exchange(body, headers), return_exceptions=True)
        return reply if isinstance(reply, Reply) else _failed(reply)

    async def _exchange(self, body: bytes, headers: Mapping[str, str]) -> Reply:
        timeout = httpx.Timeout(WHOLE_S, connect=CONNECT_S)
        async with (
            patience(),
            httpx.AsyncClient(verify=self._tls, timeout=timeout) as client,
            client.stream("POST", self._url, content=body, headers=headers) as response,
        ):
            return _judged(response.status_code)  # what follows the head is not read


def patience() -> asyncio.Timeout:
    """Time limit of one exchange."""
    return asyncio.timeout(WHOLE_S)


def _judged(status: int) -> Reply:
    if 200 <= status < 300:
        return Reply(Outcome.TAKEN)
    if 300 <= status < 400:
        return Reply(Outcome.REFUSED, f"answered {status}; redirects are not followed")
    never = Outcome.NEVER if status in _NEVER else Outcome.REFUSED
    return Reply(Outcome.LATER if status in _LATER else never, f"answered {status}")


def _failed(error: BaseException) -> Reply:
    if isinstance(error, httpx.ConnectError | httpx.ConnectTimeout | httpx.ProxyError):
        return Reply(Outcome.LATER, f"cannot be reached ({_cause(error)})")
    if isinstance(error, TimeoutError | httpx.TimeoutException):
        return Reply(Outcome.REFUSED, f"did not answer within {WHOLE_S:g} s")
    if isinstance(error, httpx.NetworkError):
        return Reply(Outcome.REFUSED, "closed the connection")
    return Reply(Outcome.REFUSED, f"sent an answer that is not HTTP ({type(error).__name__})")


def _cause(error: BaseException) -> str:
    """Error of the system below a library's."""
    while (below := error.__cause__ or error.__context__) is not None:
        error = below
    if isinstance(error, ssl.SSLCertVerificationError):
        return error.verify_message
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return type(error).__name__
