"""Occasions of a report: its period, and at once where a condition or a headline changes."""

from collections.abc import Sequence

from ....messages.health import AxisCondition
from ....messages.plant import AxisReport

LOG_SPACING_S = 5.0
"""Between two changes that are logged, so that a condition to and fro does not fill the log."""


class Occasions:
    """Occasions to publish and to log what is told of all axes.

    Args:
        period_s: a report is published in this time.
        log_period_s: one is logged in this time.
    """

    def __init__(self, period_s: float, log_period_s: float) -> None:
        self._period_s, self._log_period_s = period_s, log_period_s
        self._published_s = self._logged_s = float("-inf")
        self._published: list[tuple[AxisCondition, str, str]] = []
        self._logged: list[AxisCondition] = []

    def to_publish(self, axes: Sequence[AxisReport], now_s: float) -> bool:
        """Tell whether to publish now, and take it that this is done.

        Args:
            now_s: time of a steady clock, s.
        """
        told = [(each.condition, *_words(each)) for each in axes]
        is_due = now_s - self._published_s >= self._period_s or told != self._published
        if is_due:
            self._published_s, self._published = now_s, told
        return is_due

    def to_log(self, axes: Sequence[AxisReport], now_s: float) -> bool:
        """Tell whether to log now, and take it that this is done."""
        conditions = [each.condition for each in axes]
        since_s = now_s - self._logged_s
        is_changed = conditions != self._logged and since_s >= LOG_SPACING_S
        is_due = is_changed or since_s >= self._log_period_s
        if is_due:
            self._logged_s, self._logged = now_s, conditions
        return is_due


def _words(report: AxisReport) -> tuple[str, str]:
    return ("", "") if report.headline is None else (report.headline.level, report.headline.code)
