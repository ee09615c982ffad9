"""Validity of an estimate, with hysteresis, and the reasons where it may not be read."""

import math
from dataclasses import dataclass
from typing import Any

from pydantic import ConfigDict, with_config

from ..checks.live.channel_check import channel_reasons
from ..messages.estimate import EstimateStatus
from ..messages.features import UNUSABLE, Fault, FeatureBlock
from ..messages.stored import Stored

HOLD_S = 10.0
"""A number may stand for this long without informative motion."""
LEARN_S = 1.0
"""Informative motion needed before the first number."""
FAULT_S = 2.0
"""Without usable data for this long the estimate is invalid."""
SURPRISE_MEMORY, GROSS_MEMORY = 10.0, 60.0
"""Informative intervals over which the surprise is averaged; the same while a gross one mends."""
SURPRISE_HIGH, SURPRISE_LOW = 9.0, 4.0
"""Averaged surprise above which model and data disagree, and below which they agree again."""
SURPRISE_MOST = 40.0
"""Bound on the surprise of one interval; one alone proves nothing."""


def _key(name: str) -> str:
    """Key of a field in stored states."""
    return name if name == "informative_s" else f"_{name}"


@with_config(ConfigDict(alias_generator=_key))
@dataclass(slots=True)
class _State:
    """Everything on which the status depends; times on the axis' clock, None before the first."""

    informative_s: float = 0.0  # informative motion so far
    time_s: float | None = None
    last_informative_s: float | None = None
    last_usable_s: float | None = None
    first_s: float | None = None  # start of the first interval since an interruption
    fault_names: tuple[str, ...] = ()  # of the last unusable interval
    channels: tuple[str, ...] = ()  # caveats on the channels of the last interval
    stuck: bool = False  # a channel was, and no motion has shown since that it is free again
    surprise: float = SURPRISE_HIGH  # until it has agreed
    disagreeing: bool = True


_STORED: Stored[_State] = Stored(_State)


class Validity:
    """Status of an estimate from excitation, data faults and surprise.

    Args:
        high: averaged surprise above which model and data disagree.
        worst: bound on the surprise of one interval while they disagree: a gross error is not
            mended by the next quiet second.
    """

    def __init__(self, high: float = SURPRISE_HIGH, worst: float = SURPRISE_MOST) -> None:
        self._high, self._worst = high, worst
        self._now = _State()

    def told(self, method: str, status: EstimateStatus) -> dict[str, Any]:
        """Fields that an estimate of any method has; its time is 0 before the first interval."""
        now = self._now
        seen = {"time_s": now.time_s or 0.0, "data_used_s": now.informative_s}
        return {**seen, "method": method, "status": status}

    @property
    def widening(self) -> float:
        """Factor on the errors where innovations are larger than expected; 1 at least."""
        return math.sqrt(max(self._now.surprise, 1.0))

    def update(
        self, block: FeatureBlock, used: bool, surprise: float | None, used_s: float | None = None
    ) -> None:
        """Take an interval; `surprise` is its normalised innovation squared if it was used.

        The used motion may have gathered over `used_s` instead of the interval alone, s.
        """
        now = self._now
        if now.time_s is not None and block.time_s < now.time_s:
            self.interrupt()
        now.time_s, now.channels = block.time_s, channel_reasons(block.fault)
        if now.first_s is None:
            now.first_s = block.time_s - block.duration_s
        now.stuck = not used and (now.stuck or Fault.STUCK in block.fault)
        if not block.usable:
            now.fault_names = tuple(str(fault.name).lower() for fault in block.fault & UNUSABLE)
        elif not now.stuck:  # an axis at rest does not show that it is free again
            now.last_usable_s = block.time_s
        if used:
            now.informative_s += block.duration_s if used_s is None else used_s
            now.last_informative_s = block.time_s
        if used and surprise is not None:
            most = self._worst if now.disagreeing else SURPRISE_MOST
            mends = now.disagreeing and now.surprise > max(surprise, self._high)
            memory = GROSS_MEMORY if mends else SURPRISE_MEMORY
            now.surprise += (min(surprise, most) - now.surprise) / memory
            now.disagreeing = now.surprise > (SURPRISE_LOW if now.disagreeing else self._high)

    def interrupt(self) -> None:
        """Treat earlier data as of unknown age: no number stands on it until motion is seen."""
        self._now.last_informative_s = None
        self._now.last_usable_s = None
        self._now.first_s = None

    def status(self) -> tuple[EstimateStatus, tuple[str, ...]]:
        """Status, with the reasons why it is not `estimated` and the caveats on channels."""
        now = self._now
        status, reason = EstimateStatus.ESTIMATED, ""
        if now.time_s is None or now.first_s is None:
            status, reason = EstimateStatus.UNESTIMATED, "no_data: no sample has arrived yet"
        elif (
            now.time_s - (now.first_s if now.last_usable_s is None else now.last_usable_s)
            >= FAULT_S
        ):
            status, reason = EstimateStatus.INVALID, f"data_fault: {', '.join(now.fault_names)}"
        elif still := self._without_motion(now.time_s):
            status, reason = EstimateStatus.INSUFFICIENT_EXCITATION, f"no_motion: {still}"
        elif now.informative_s < LEARN_S:
            status = EstimateStatus.UNESTIMATED
            reason = f"learning: {now.informative_s:.1f} of {LEARN_S:.1f} s of steady motion seen"
        elif now.disagreeing:
            status = EstimateStatus.INVALID
            reason = (
                "model_mismatch: no level of the model explains the torque "
                f"(normalised innovation squared {now.surprise:.0f}, expected about 1)"
            )
        return status, (*((reason,) if reason else ()), *now.channels)

    def _without_motion(self, time_s: float) -> str | None:
        if self._now.informative_s == 0.0:
            return "the axis has not moved steadily yet"
        if self._now.last_informative_s is None:
            return "no steady motion since the data were interrupted"
        rest_s = time_s - self._now.last_informative_s
        return f"no steady motion for {rest_s:.0f} s" if rest_s > HOLD_S else None

    def snapshot(self) -> dict[str, Any]:
        """State as JSON-able values."""
        return dict(_STORED.dump(self._now))

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; ValueError if it is none."""
        self._now = _STORED.load(snapshot)
