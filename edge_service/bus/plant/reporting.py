"""Reports of one machine at the plant's bus: none is lost while a router is away for a while."""

import time
from itertools import count

import zenoh
from zenoh import ext

from ...clock import now_ns
from ...messages.codec.json_message import JSON_ENCODING
from ...messages.header import Header
from ...messages.plant import MOST_REPORT_BYTES, REPORT, MachineReport, PlantKeys
from ..questions import Answer, Answering
from .session import PlantSession

MOST_CACHED = 600
"""Reports that are kept for readers that have missed them; ten minutes of one a second."""
_CACHE_BYTES, _AXIS_BYTES = 8e6, 1000
HEARTBEAT_S = 10.0
"""Period of the last report's number, or that of the reports if they are rarer, s.

By it a reader learns what it has missed of a machine that rests. It is told again and again: told
once, it is lost with the router that was to pass it on, and with it all that was reported before.
"""


class OversizedReportError(ValueError):
    """A report that no reader would take."""


class Reporting:
    """Publisher of one machine's reports, and answers about its log. Needs a running event loop.

    Args:
        axes: number of axes in a report, by which the cache is bounded.
        period_s: between the reports, s.
        answer: answers questions to the log.
    """

    def __init__(
        self, session: PlantSession, keys: PlantKeys, axes: int, period_s: float, answer: Answer
    ) -> None:
        self._boot_epoch, self._numbers = now_ns(), count()
        self._publisher = ext.declare_advanced_publisher(
            session.zenoh,
            keys.report,
            encoding=zenoh.Encoding(JSON_ENCODING),
            congestion_control=zenoh.CongestionControl.DROP,  # and recovered from the cache
            cache=ext.CacheConfig(max_samples=cached_reports(axes)),
            sample_miss_detection=ext.MissDetectionConfig(
                heartbeat=max(HEARTBEAT_S, period_s), sporadic_heartbeat=None
            ),
            publisher_detection=True,
        )
        self._answering = Answering(session.zenoh, keys.log, answer)

    def publish(self, report: MachineReport) -> Header:
        """Number and put a report; never waits for a reader. Raises OversizedReportError."""
        header = Header(
            next(self._numbers), self._boot_epoch, max(report.time_ns, 0), time.monotonic_ns()
        )
        payload = REPORT.encode(None, header, report)
        if len(payload) > MOST_REPORT_BYTES:
            raise OversizedReportError(
                f"a report of {len(payload)} bytes on {len(report.axes)} axes is too long; "
                f"{MOST_REPORT_BYTES} are taken"
            )
        self._publisher.put(payload)
        return header

    @property
    def refused(self) -> int:
        """Questions that were too long or too many, so that nobody has read them."""
        return self._answering.refused

    def close(self) -> None:
        """Undeclare; for a session that is still open."""
        self._answering.close()
        self._publisher.undeclare()


def cached_reports(axes: int) -> int:
    """Reports that the cache holds: fewer of a machine with very many axes.

    >>> cached_reports(8), cached_reports(100)
    (600, 80)
    """
    return max(1, min(MOST_CACHED, int(_CACHE_BYTES / (_AXIS_BYTES * max(axes, 1)))))
