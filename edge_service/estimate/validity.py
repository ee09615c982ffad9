"""Validity of an estimate, with hysteresis, and the reasons where it may not be read."""

from dataclasses import dataclass
from typing import Any

from pydantic import ConfigDict, with_config

from ..checks.live.reasons import channel_reasons
from ..messages.estimate import EstimateStatus
from ..messages.features import UNUSABLE, Fault, FeatureBlock
from ..messages.stored import Stored

_Verdict = tuple[EstimateStatus, tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class ValiditySettings:
    """Thresholds of the status.

    Attributes:
        learn_s: informative motion needed before the first number, s.
        fault_s: without usable data for this long the estimate is invalid, s.
        surprise_memory: informative intervals over which the surprise is averaged.
        surprise_high: averaged surprise above which model and data disagree.
        surprise_most: bound on the surprise of one interval; one alone proves nothing.
        surprise_worst: the same while model and data disagree: a gross error is not mended by the
            next quiet second.
        surprise_low: averaged surprise below which they agree again.
    """

    learn_s: float = 1.0
    fault_s: float = 2.0
    surprise_memory: float = 10.0
    surprise_high: float = 9.0
    surprise_most: float = 40.0
    surprise_worst: float = 40.0
    surprise_low: float = 4.0


def _key(name: str) -> str:
    """Key of a field in stored states."""
    return name if name == "informative_s" else f"_{name}"


@with_config(ConfigDict(alias_generator=_key))
@dataclass(slots=True)
class _State:
    """Everything on which the status depends; times on the axis' clock, None before the first.

    Attributes:
        informative_s: informative motion so far, s.
        first_s: start of the first interval since an interruption.
        fault_names: of the last unusable interval.
        channels: caveats on the channels of the last interval.
        stuck: a channel was stuck, and no motion has shown since that it is free again.
    """

    informative_s: float = 0.0
    time_s: float | None = None
    last_informative_s: float | None = None
    last_usable_s: float | None = None
    first_s: float | None = None
    fault_names: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    stuck: bool = False
    surprise: float = 0.0
    disagreeing: bool = False


_STORED: Stored[_State] = Stored(_State)


class Validity:
    """Status of an estimate from excitation, data faults and surprise.

    Args:
        settings: thresholds.
        hold_s: a number may stand for this long without informative motion.
    """

    def __init__(self, settings: ValiditySettings, hold_s: float) -> None:
        self._settings = settings
        self._hold_s = hold_s
        self._now = _State()

    @property
    def informative_s(self) -> float:
        """Informative motion so far, s."""
        return self._now.informative_s

    @property
    def time_s(self) -> float:
        """End of the last interval on the axis' clock, s; 0 before the first."""
        return 0.0 if self._now.time_s is None else self._now.time_s

    def update(
        self,
        block: FeatureBlock,
        used: bool,
        surprise: float | None,
        used_s: float | None = None,
    ) -> None:
        """Take an interval; `surprise` is its normalised innovation squared if it was used.

        The used motion may have gathered over `used_s` instead of the interval alone, s.
        """
        if self._now.time_s is not None and block.time_s < self._now.time_s:
            self.interrupt()
        self._now.time_s = block.time_s
        self._now.channels = channel_reasons(block.fault)
        if self._now.first_s is None:
            self._now.first_s = block.time_s - block.duration_s
        self._now.stuck = not used and (self._now.stuck or Fault.STUCK in block.fault)
        if (
            block.usable and not self._now.stuck
        ):  # an axis at rest does not show that it is free again
            self._now.last_usable_s = block.time_s
        elif not block.usable:
            self._now.fault_names = tuple(
                str(fault.name).lower() for fault in block.fault & UNUSABLE
            )
        if used:
            self._now.informative_s += block.duration_s if used_s is None else used_s
            self._now.last_informative_s = block.time_s
            if surprise is not None:
                self._follow_surprise(surprise)

    def interrupt(self) -> None:
        """Treat earlier data as of unknown age: no number stands on it until motion is seen."""
        self._now.last_informative_s = None
        self._now.last_usable_s = None
        self._now.first_s = None

    def _follow_surprise(self, surprise: float) -> None:
        share, most = 1.0 / self._settings.surprise_memory, self._settings.surprise_most
        if self._now.disagreeing:
            most = self._settings.surprise_worst
        self._now.surprise += share * (min(surprise, most) - self._now.surprise)
        if self._now.surprise > self._settings.surprise_high:
            self._now.disagreeing = True
        elif self._now.surprise < self._settings.surprise_low:
            self._now.disagreeing = False

    def status(self) -> tuple[EstimateStatus, tuple[str, ...]]:
        """Status, with the reasons why it is not `estimated` and the caveats on channels."""
        status, reasons = self._without_channels()
        return status, (*reasons, *self._now.channels)

    def _without_channels(self) -> _Verdict:
        if self._now.time_s is None or self._now.first_s is None:
            return EstimateStatus.UNESTIMATED, ("no_data: no sample has arrived yet",)
        usable_since = (
            self._now.first_s if self._now.last_usable_s is None else self._now.last_usable_s
        )
        if self._now.time_s - usable_since >= self._settings.fault_s:
            return EstimateStatus.INVALID, (f"data_fault: {', '.join(self._now.fault_names)}",)
        return (
            self._missing_motion(self._now.time_s)
            or self._disagreement()
            or (EstimateStatus.ESTIMATED, ())
        )

    def _missing_motion(self, time_s: float) -> _Verdict | None:
        if self._now.informative_s == 0.0:
            reason = "no_motion: the axis has not moved steadily yet"
            return EstimateStatus.INSUFFICIENT_EXCITATION, (reason,)
        if self._now.last_informative_s is None:
            reason = "no_motion: no steady motion since the data were interrupted"
            return EstimateStatus.INSUFFICIENT_EXCITATION, (reason,)
        rest_s = time_s - self._now.last_informative_s
        if rest_s > self._hold_s:
            reason = f"no_motion: no steady motion for {rest_s:.0f} s"
            return EstimateStatus.INSUFFICIENT_EXCITATION, (reason,)
        if self._now.informative_s < self._settings.learn_s:
            return EstimateStatus.UNESTIMATED, (
                f"learning: {self._now.informative_s:.1f} of {self._settings.learn_s:.1f} s "
                "of steady motion seen",
            )
        return None

    def _disagreement(self) -> _Verdict | None:
        if not self._now.disagreeing:
            return None
        return EstimateStatus.INVALID, (
            "model_mismatch: no level of the model explains the torque "
            f"(normalised innovation squared {self._now.surprise:.0f}, expected about 1)",
        )

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values."""
        return dict(_STORED.dump(self._now))

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        self._now = _STORED.load(snapshot)
