"""Delay of a sample until `/preload` rests on it."""

import http.client
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from edge_service.messages.samples import Floats

from ..table import PipelineBenchError

_NS_PER_S = 1_000_000_000
_ANSWER_PATIENCE_S = 10.0


@dataclass(frozen=True, slots=True)
class Sighting:
    """An answer with the time at which it was in hand.

    Attributes
    ----------
    status : str
        Status of the estimate.
    measured_ns : int or None
        `measured_at`, the end of the newest interval behind it, UNIX ns in steps of 1 ms.
    seen_ns : int
        UNIX time of the answer, ns.
    """

    status: str
    measured_ns: int | None
    seen_ns: int


class PreloadPoller:
    """Asks for the preload of one axis over one kept-alive connection."""

    def __init__(self, host: str, port: int, axis: str) -> None:
        self._connection = http.client.HTTPConnection(host, port, timeout=_ANSWER_PATIENCE_S)
        self._path = f"/api/v1/axes/{axis}/preload"

    def ask(self) -> Sighting:
        """The answer of now; PipelineBenchError if there is none."""
        try:
            answer = self._answer()
            seen_ns = time.time_ns()
            status, measured_at = answer["status"], answer["measured_at"]
        except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
            problem = f"{type(error).__name__}: {error}"
            raise PipelineBenchError(f"GET {self._path}: no preload ({problem})") from None
        return Sighting(status, None if measured_at is None else unix_ns(measured_at), seen_ns)

    def _answer(self) -> dict[str, Any]:
        try:
            return self._get()
        except ConnectionError:  # a server ends a kept connection that was silent for a while
            self._connection.close()
            return self._get()

    def _get(self) -> dict[str, Any]:
        self._connection.request("GET", self._path)
        answer: dict[str, Any] = json.loads(self._connection.getresponse().read())
        return answer

    def close(self) -> None:
        """Close the connection; safe twice."""
        self._connection.close()


def unix_ns(moment: str) -> int:
    """UNIX time in ns, to the millisecond, of an RFC 3339 moment."""
    return round(datetime.fromisoformat(moment).timestamp() * 1e3) * 1_000_000


def first_sightings(sightings: Sequence[Sighting]) -> list[tuple[int, int]]:
    """`(measured_ns, seen_ns)` of each interval when it was seen first.

    The interval of the first answer is left out: nobody knows since when it was there.
    """
    firsts: list[tuple[int, int]] = []
    for sighting in sightings:
        if sighting.measured_ns is not None and (
            not firsts or sighting.measured_ns > firsts[-1][0]
        ):
            firsts.append((sighting.measured_ns, sighting.seen_ns))
    return firsts[1:]


def interval_delays_s(firsts: Sequence[tuple[int, int]], interval_s: float) -> Floats:
    """Delay of the end of each interval, s, shape (n_intervals,).

    An interval that was never seen by itself is there from the next one's sighting on.
    """
    delays: list[float] = []
    before_ns: int | None = None
    for measured_ns, seen_ns in firsts:
        passed_s = interval_s if before_ns is None else (measured_ns - before_ns) / _NS_PER_S
        delay_s = (seen_ns - measured_ns) / _NS_PER_S
        delays += [delay_s + k * interval_s for k in range(max(1, round(passed_s / interval_s)))]
        before_ns = measured_ns
    return np.array(delays)


def sample_delays_s(interval_delay_s: Floats, interval_s: float, period_s: float) -> Floats:
    """Delay of every sample, s, shape (n_intervals * samples per interval,).

    `measured_at` is the end of an interval; its samples lie 1, 2, ... periods before.
    """
    before_end_s = period_s * np.arange(1, round(interval_s / period_s) + 1)
    return np.asarray((interval_delay_s[:, np.newaxis] + before_end_s).ravel())
