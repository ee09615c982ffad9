"""Last values of one axis, and what is known of it along its stroke."""

from typing import Protocol

from ..messages.answer import AxisAnswer
from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition
from ..messages.health import AxisHealth
from ..messages.samples import Floats
from ..messages.topics import HEALTH, PRELOAD
from .advice import consistent
from .components import ComponentWatch
from .inputs import InputWatch
from .limits import AxisLimits
from .live_features import LiveFeatures

StrokeBand = tuple[Floats, Floats, Floats]
"""Value, lower and upper bound of a quantity along the stroke, (n,) each."""


class StrokeModel(Protocol):
    """Preload and stiffness along the stroke for a mean preload with its bounds, percent."""

    @property
    def position_m(self) -> Floats:
        """Places along the stroke, m, (n,)."""
        ...

    @property
    def fresh_percent(self) -> float:
        """Mean preload when the axis was commissioned, percent."""
        ...

    @property
    def knows_stiffness(self) -> bool:
        """True if `stiffness` can be asked."""
        ...

    def preload(self, percent: float, low: float, high: float) -> StrokeBand:
        """Preload at every place, percent."""
        ...

    def stiffness(self, percent: float, low: float, high: float) -> StrokeBand:
        """Series stiffness between motor and table at every place, N/m."""
        ...


class AxisState:
    """Data known of one axis."""

    def __init__(
        self,
        axis: str,
        limits: AxisLimits | None = None,
        ratio_m_per_rad: float | None = None,
        components: ComponentWatch | None = None,
    ) -> None:
        self.axis, self.limits = axis, limits
        self.live = LiveFeatures(ratio_m_per_rad)
        self._components = components or ComponentWatch(HEALTH.stale_after_s)
        self.versions: dict[str, int] = {}
        self.preload_input = InputWatch(PRELOAD.stale_after_s)
        self.health_input = InputWatch(HEALTH.stale_after_s)
        self.estimate: PreloadEstimate | None = None
        self.health: AxisHealth | None = None

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Reasons why nothing current can be said; empty if it can."""
        reasons = (self._missing_preload(now_ns), _missing_health(self, now_ns))
        return tuple(reason for reason in reasons if reason is not None)

    def readable(self, now_ns: int) -> PreloadEstimate:
        """The estimate without what must not be read now."""
        estimate = self.estimate
        missing = self._missing_preload(now_ns)
        if estimate is None or missing is not None:
            return PreloadEstimate(
                time_s=0.0 if estimate is None else estimate.time_s,
                status=EstimateStatus.UNESTIMATED,
                reasons=() if missing is None else (missing,),
            )
        if estimate.status is EstimateStatus.ESTIMATED:
            return estimate
        return PreloadEstimate(
            time_s=estimate.time_s,
            status=estimate.status,
            method=estimate.method,
            reasons=estimate.reasons,
            level=estimate.level,
            data_used_s=estimate.data_used_s,
        )

    def answer(self, started_ns: int, now_ns: int) -> AxisAnswer:
        """All that may be read of the axis now."""
        header = self.preload_input.header
        return AxisAnswer(
            axis=self.axis,
            estimate=self.readable(now_ns),
            measured_ns=None if header is None else header.source_time_ns,
            health=self.told(started_ns, now_ns),
            is_heard=not self.missing(now_ns),
            header=header,
        )

    def told(self, started_ns: int, now_ns: int) -> AxisHealth:
        """Condition of the axis now; UNAVAILABLE as soon as it rests on something stale."""
        last = self.health or AxisHealth(
            axis=self.axis, condition=AxisCondition.UNAVAILABLE, since_time_ns=started_ns
        )
        estimate, heard = self.readable(now_ns), self.preload_input.header
        changes: dict[str, object] = {
            "status": estimate.status,
            "method": estimate.method,
            "measured_time_ns": None if heard is None else heard.source_time_ns,
        }
        if self.limits is not None:
            changes["limits"] = self.limits.shown
        missing = self.missing(now_ns)
        if missing:
            own = last.reasons if last.condition is AxisCondition.UNAVAILABLE else ()
            changes["reasons"] = tuple(dict.fromkeys((*missing, *own)))
        if missing and last.condition is not AxisCondition.UNAVAILABLE:
            changes["condition"] = AxisCondition.UNAVAILABLE
            changes["since_time_ns"] = max(self._missing_since_ns(now_ns), started_ns)
        return consistent(last.model_copy(update=changes), estimate)

    def _missing_preload(self, now_ns: int) -> str | None:
        heard = self.preload_input
        if not heard.is_stale(now_ns):
            return None
        preparing = self._components.preparing(self.axis, now_ns)
        if preparing is not None:
            return preparing
        if heard.header is None:
            return "no_input: no preload estimate heard yet"
        return f"stale_input: no new preload estimate for more than {heard.stale_after_s:g} s"

    def _missing_since_ns(self, now_ns: int) -> int:
        inputs = (self.preload_input, self.health_input)
        return min(each.stale_since_ns for each in inputs if each.is_stale(now_ns))


def _missing_health(state: AxisState, now_ns: int) -> str | None:
    health_input = state.health_input
    if health_input.header is None:
        return "no_health: the condition was not heard yet"
    if health_input.is_stale(now_ns):
        return f"stale_health: condition not renewed for more than {health_input.stale_after_s:g} s"
    return None
