"""Asks many services at once, each within a bounded time."""

import http.client
import json
import queue
import ssl
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any
from urllib.parse import quote

from ...config_tables import FleetConfig, FleetServiceConfig
from ...health.fleet.rows import FleetRow, compared
from ...secret_files import SecretError, read_secret
from .rows import StrangeAnswerError, rows_of, unreachable

MOST_BYTES = 4_000_000
_CHUNK_BYTES = 65_536
Ask = Callable[[str, float], Any]
"""(address, seconds left) -> the JSON that is answered there. Raises OSError, ValueError."""


class UnansweredError(Exception):
    """A service did not answer; the text says why."""


class _NoRedirects(urllib.request.HTTPRedirectHandler):
    """A token is shown to the service alone, wherever that points to."""

    def redirect_request(self, *_args: Any, **_named: Any) -> None:
        """Follow none."""


def asker_of(service: FleetServiceConfig) -> Ask:
    """Asks a service by HTTP, with its token if it has one. Raises UnansweredError."""
    try:
        handlers: list[urllib.request.BaseHandler] = [urllib.request.ProxyHandler({})]
        if service.ca_certificate is not None:
            trusted = ssl.create_default_context(cafile=service.ca_certificate)
            handlers.append(urllib.request.HTTPSHandler(context=trusted))
        headers = {}
        if service.token_file is not None:
            handlers.append(_NoRedirects())
            headers["Authorization"] = f"Bearer {read_secret(service.token_file)}"
    except SecretError as error:
        raise UnansweredError(f"token_file: {error}") from None
    except OSError as error:
        raise UnansweredError(f"ca_certificate: {error.strerror or 'holds none'}") from None
    return partial(ask_http, urllib.request.build_opener(*handlers), headers)


def ask_http(
    opener: urllib.request.OpenerDirector, headers: dict[str, str], address: str, left_s: float
) -> Any:
    """The JSON at an address, bounded in time and size."""
    end_s = time.monotonic() + left_s
    content = bytearray()
    request = urllib.request.Request(address, headers=headers)
    with opener.open(request, timeout=left_s) as response:
        while chunk := response.read1(_CHUNK_BYTES):
            content += chunk
            if len(content) > MOST_BYTES:
                raise UnansweredError(f"answers more than {MOST_BYTES / 1e6:g} MB")
            if time.monotonic() > end_s:
                raise TimeoutError
    return json.loads(content)


def ask_fleet(fleet: FleetConfig, ask: Ask | None = None) -> list[FleetRow]:
    """One row per axis of every service, the worst first; returns within `timeout_s`.

    Args:
        ask: In place of HTTP.
    """
    answers: queue.SimpleQueue[tuple[int, list[FleetRow]]] = queue.SimpleQueue()
    end_s = time.monotonic() + fleet.timeout_s
    for index, service in enumerate(fleet.services):
        work = partial(_put_rows, answers, index, service, end_s, ask)
        threading.Thread(target=work, daemon=True).start()  # a stuck one must not hold us up
    late = f"no answer within {fleet.timeout_s:g} s"
    rows = [[unreachable(each.address, each.name, late)] for each in fleet.services]
    try:
        for _ in fleet.services:
            index, heard = answers.get(timeout=max(end_s - time.monotonic(), 0.0))
            rows[index] = heard
    except queue.Empty:
        pass
    return compared([row for each in rows for row in each])


def _put_rows(
    answers: "queue.SimpleQueue[tuple[int, list[FleetRow]]]",
    index: int,
    service: FleetServiceConfig,
    end_s: float,
    ask: Ask | None,
) -> None:
    try:
        rows = _ask_service(service.address, end_s, ask or asker_of(service))
    except (UnansweredError, StrangeAnswerError) as error:
        rows = [unreachable(service.address, service.name, str(error))]
    answers.put((index, rows))


def _ask_service(address: str, end_s: float, ask: Ask) -> list[FleetRow]:
    axes = _answer(address, "/api/v1/axes", end_s, ask)
    health = _answer(address, "/api/v1/health", end_s, ask)
    preloads = [
        _answer(address, f"/api/v1/axes/{quote(name, safe='')}/preload", end_s, ask)
        for name in _names(axes)
    ]
    return rows_of(address, axes, health, preloads)


def _names(axes: Any) -> Sequence[str]:
    try:
        return [str(each["axis"]) for each in axes["axes"]]
    except (KeyError, TypeError):
        raise StrangeAnswerError("no answer of an edge-service: no axes") from None


def _answer(address: str, path: str, end_s: float, ask: Ask) -> Any:
    left_s = end_s - time.monotonic()
    try:
        if left_s <= 0.0:
            raise TimeoutError
        return ask(f"{address}{path}", left_s)
    except urllib.error.HTTPError as error:
        error.close()
        raise UnansweredError(f"{path} answers {error.code}") from None
    except TimeoutError:
        raise UnansweredError("too slow") from None
    except urllib.error.URLError as error:
        raise UnansweredError(_reason(error.reason)) from None
    except OSError as error:
        raise UnansweredError(_reason(error)) from None
    except ValueError:
        raise StrangeAnswerError(f"{path} answers no JSON") from None
    except http.client.HTTPException as error:
        raise UnansweredError(f"speaks no HTTP ({type(error).__name__})") from None


def _reason(error: object) -> str:
    if isinstance(error, TimeoutError):
        return "too slow"
    text = getattr(error, "strerror", None) or str(error)
    return f"cannot be reached ({text})"
