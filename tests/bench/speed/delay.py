"""Delay of a sample until `/preload` rests on it."""

import http.client
import json
import time
from contextlib import closing
from datetime import datetime
from itertools import pairwise

import numpy as np

from edge_service.messages.samples import Floats

from ..table import BenchError

INTERVAL_S, PERIOD_S = 0.1, 0.001
_POLL_PERIOD_S, _PATIENCE_S = 0.005, 10.0


class PreloadPoller:
    """Asks for the preload of one axis over one kept-alive connection."""

    def __init__(self, host: str, port: int, axis: str) -> None:
        self._connection = http.client.HTTPConnection(host, port, timeout=_PATIENCE_S)
        self._path = f"/api/v1/axes/{axis}/preload"

    def ask(self) -> tuple[str, float | None]:
        """Status of now, and end of the newest interval behind it, s; BenchError without one."""
        try:
            self._connection.request("GET", self._path)
            answer = json.loads(self._connection.getresponse().read())
            status, measured = answer["status"], answer["measured_at"]
        except (OSError, http.client.HTTPException, ValueError, KeyError) as error:
            raise BenchError(f"GET {self._path}: no preload ({error!r})") from None
        return status, None if measured is None else datetime.fromisoformat(measured).timestamp()

    def close(self) -> None:
        self._connection.close()


def sample_delays_s(host: str, port: int, axis: str, window_s: float) -> Floats:
    """Delay of every sample of a window, s, (n_samples,).

    An interval that was never seen by itself is there from the next one's sighting on; that of the
    first answer is left out, because nobody knows since when it was there.
    """
    firsts, until_s, newest_s = [], time.monotonic() + window_s, -np.inf
    with closing(PreloadPoller(host, port, axis)) as poller:
        while time.monotonic() < until_s:
            _, measured_s = poller.ask()
            if measured_s is not None and measured_s > newest_s:
                newest_s = measured_s
                firsts.append((measured_s, time.time()))
            time.sleep(_POLL_PERIOD_S)
    delays: list[float] = []
    for (before_s, _), (measured_s, seen_s) in pairwise(firsts):
        count = max(1, round((measured_s - before_s) / INTERVAL_S))
        delays += [seen_s - measured_s + k * INTERVAL_S for k in range(count)]
    before_end_s = PERIOD_S * np.arange(1, round(INTERVAL_S / PERIOD_S) + 1)
    return np.asarray((np.array(delays)[:, np.newaxis] + before_end_s).ravel())
