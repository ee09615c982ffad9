"""Settings of the condition of an axis."""

from dataclasses import dataclass

from ..messages.health import Limits
from ..messages.topics import FEAT, HEALTH, PRELOAD


@dataclass(frozen=True, slots=True)
class AxisLimits:
    """Limits of one axis, all in percent of the dynamic load rating."""

    fresh_percent: float
    warning_percent: float
    fault_percent: float
    hysteresis_percent: float

    @property
    def shown(self) -> Limits:
        """Those that people see."""
        return Limits(
            fresh_percent=self.fresh_percent,
            warning_percent=self.warning_percent,
            fault_percent=self.fault_percent,
        )


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """Limits and delays of the condition; the limits are a convention that the owner may change.

    Attributes:
        warning_below_percent: WARNING below this share of the fresh preload, percent.
        fault_below_percent: FAULT below this share of the fresh preload, percent.
        hysteresis_percent: how far above a limit the preload must rise to leave it, in percent of
            the fresh preload.
        delay_s: how long the whole interval must lie beyond a limit.
        doubt_delay_s: how long the value must lie beyond a limit that its interval still straddles.
        grace_s: how long a condition is kept while estimates come, but without a number.
        fault_clear_s: a data fault is over when it was not seen for this long.
        preload_stale_after_s: without a preload estimate for this long the input is missing.
        feature_stale_after_s: the same for feature blocks.
        component_silent_after_s: a component that reports nothing for this long is in error; None
            if components report on change only.
    """

    warning_below_percent: float = 60.0
    fault_below_percent: float = 30.0
    hysteresis_percent: float = 5.0
    delay_s: float = 0.3
    doubt_delay_s: float = 10.0
    grace_s: float = 10.0
    fault_clear_s: float = 5.0
    preload_stale_after_s: float = PRELOAD.stale_after_s
    feature_stale_after_s: float = FEAT.stale_after_s
    component_silent_after_s: float | None = HEALTH.stale_after_s

    def __post_init__(self) -> None:
        if not 0.0 < self.fault_below_percent < self.warning_below_percent < 100.0:
            raise ValueError(
                "limits must satisfy 0 < fault_below_percent < warning_below_percent < 100, got "
                f"{self.fault_below_percent:g} and {self.warning_below_percent:g}"
            )
        for name in ("hysteresis_percent", "delay_s", "doubt_delay_s", "grace_s", "fault_clear_s"):
            if not getattr(self, name) >= 0.0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name):g}")

    def limits(self, fresh_preload_percent: float | None) -> AxisLimits | None:
        """Limits of an axis, or None where the fresh screw's preload is not known.

        Args:
            fresh_preload_percent: Preload of the fresh screw in percent of the dynamic load rating.
        """
        if fresh_preload_percent is None:
            return None
        if not fresh_preload_percent > 0.0:
            raise ValueError(
                f"fresh_preload_percent must be greater than 0, got {fresh_preload_percent:g}"
            )
        point = fresh_preload_percent / 100.0
        return AxisLimits(
            fresh_percent=fresh_preload_percent,
            warning_percent=self.warning_below_percent * point,
            fault_percent=self.fault_below_percent * point,
            hysteresis_percent=self.hysteresis_percent * point,
        )
