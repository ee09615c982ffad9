"""The last word on one axis: what may be read of it now, and nothing else."""

from ..messages.answer import AxisAnswer, of_fresh
from ..messages.estimate import EstimateStatus, ImmEstimate, PreloadEstimate
from ..messages.event import AxisCondition
from ..messages.health import AxisHealth, Limits
from ..messages.topics import HEALTH, IMM, PRELOAD
from .advice import consistent
from .components import ComponentWatch
from .inputs import Heard


class AxisState:
    """Last estimate and condition of one axis, and how old they are."""

    def __init__(self, axis: str, limits: Limits | None, components: ComponentWatch) -> None:
        self.axis, self.limits = axis, limits
        self._components = components
        self.preload = Heard[PreloadEstimate](PRELOAD.stale_after_s)
        self.health = Heard[AxisHealth](HEALTH.stale_after_s)
        self.imm = Heard[ImmEstimate](IMM.stale_after_s)

    def missing(self, now_ns: int) -> tuple[str, ...]:
        """Reasons why nothing current can be said; empty if it can."""
        heard, health = self.health, None
        if heard.header is None:
            health = "no_health: the condition was not heard yet"
        elif heard.is_stale(now_ns):
            health = f"stale_health: condition not renewed for more than {heard.stale_after_s:g} s"
        preload = self._components.missing(self.preload, self.axis, now_ns)
        return tuple(filter(None, (preload, health)))

    def readable(self, now_ns: int) -> PreloadEstimate:
        """The estimate without what must not be read now."""
        estimate = self.preload.payload
        missing = self._components.missing(self.preload, self.axis, now_ns)
        if estimate is None or missing is not None:
            return PreloadEstimate(
                time_s=0.0 if estimate is None else estimate.time_s,
                status=EstimateStatus.UNESTIMATED,
                reasons=() if missing is None else (missing,),
            )
        if estimate.status is EstimateStatus.ESTIMATED:
            return estimate
        kept = {"time_s", "status", "method", "reasons", "level", "data_used_s"}
        return PreloadEstimate(**{name: getattr(estimate, name) for name in kept})

    def opinion(self, now_ns: int) -> ImmEstimate:
        """The second opinion; without numbers where none may be read now."""
        last = self.imm.payload or ImmEstimate(axis=self.axis)
        if not self.imm.is_stale(now_ns):
            return last
        measured_ns = last.measured_time_ns
        return ImmEstimate(axis=self.axis, engine=last.engine, measured_time_ns=measured_ns)

    def answer(self, started_ns: int, now_ns: int) -> AxisAnswer:
        """All that may be read of the axis now."""
        return AxisAnswer(
            axis=self.axis,
            estimate=self.readable(now_ns),
            measured_ns=self.preload.measured_ns,
            health=self.told(started_ns, now_ns),
            is_heard=not self.missing(now_ns),
            header=self.preload.header,
            opinion=self.opinion(now_ns),
        )

    def told(self, started_ns: int, now_ns: int) -> AxisHealth:
        """Condition of the axis now; UNAVAILABLE as soon as it rests on something stale."""
        unavailable = AxisCondition.UNAVAILABLE
        last = self.health.payload or AxisHealth(
            axis=self.axis, condition=unavailable, since_time_ns=started_ns
        )
        estimate, limits = self.readable(now_ns), self.limits or last.limits
        changes: dict[str, object] = {
            "status": estimate.status,
            "method": estimate.method,
            "measured_time_ns": self.preload.measured_ns,
            "limits": limits,
            "components": self._components.reports(now_ns, self.axis) or last.components,
        }
        missing = self.missing(now_ns)
        is_known = last.condition is not unavailable and not missing
        fresh = None if limits is None or not is_known else limits.fresh_percent
        changes["of_fresh"] = of_fresh(estimate, fresh)
        if missing:
            own = last.reasons if last.condition is unavailable else ()
            changes["reasons"] = tuple(dict.fromkeys((*missing, *own)))
        if missing and last.condition is not unavailable:
            inputs = (self.preload, self.health)
            since_ns = min(each.stale_since_ns for each in inputs if each.is_stale(now_ns))
            changes["condition"] = unavailable
            changes["since_time_ns"] = max(since_ns, started_ns)
        return consistent(last.model_copy(update=changes), estimate)
