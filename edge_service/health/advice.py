"""Advice on what to do at an axis, by when, and what else in the same stop."""

from collections.abc import Iterator

from ..messages.estimate import EstimateStatus, PreloadEstimate
from ..messages.event import AxisCondition
from ..messages.health import Advice, AlarmKind, AxisHealth, Task
from ..messages.trend import TrendStatus
from .headline import REASONS, as_of_now, headline, is_in_doubt

LIKELY_GREASE = 0.9
"""Probability of more friction at the same preload from which regreasing is advised."""
TEXTS = {
    Task.INSPECT: "Stop the axis and look for damage: nut, balls, bearings, coupling.",
    Task.REPLACE_NUT: (
        "Replace or readjust the nut, then note “part replaced”. Until then expect backlash "
        "and scrap."
    ),
    Task.CONFIRM_LOSS: "Confirm the loss of preload by a test before you replace the nut.",
    Task.PLAN_NUT: "Plan to replace or readjust the nut.",
    Task.FIND_WEAR: "Find out why the screw wears fast: load, lubrication, dirt.",
    Task.DIAGNOSE: (
        "Do not rely on the number yet. Check sensors and machine file; if they are right, "
        "record a test and run a diagnosis."
    ),
    Task.REGREASE: "Regrease the screw: its friction has risen, not its preload.",
    Task.TEST: "Run the test by shaking (under Tests): there is none of the last 7 days.",
    Task.FIND_CHANGE: (
        "Find out what changed: a new part, other grease, a repair? If a part was replaced, "
        "note “part replaced”."
    ),
    Task.CHECK_SERVICE: "Look at the parts of the service: one of them does not work.",
    Task.CHECK_CONNECTION: "Check the connection to the drive: no data are coming in.",
    Task.SWITCH_ON: "Check that the drive is on and connected: no data have come in yet.",
    Task.COMPLETE_MACHINE_FILE: (
        "Complete the machine file: the fresh screw's preload or the load rating is missing."
    ),
    Task.COMMISSION_SOURCE: (
        "Commission the axis from recordings of this source: its samples are slower than those of "
        "the commissioning."
    ),
    Task.MOVE_FREELY: "Let the axis move without cutting for a few seconds, such as a warm-up.",
    Task.MOVE: "Move the axis: its preload cannot be measured at rest.",
    Task.WAIT: "Wait a moment, and let the axis go on moving.",
    Task.ACKNOWLEDGE: "Acknowledge the alarm once you have taken note.",
}
"""Words of each task; those of the page are the same."""
_PASSED = {AxisCondition.WARNING: ("warning",), AxisCondition.FAULT: ("warning", "fault")}


def advice(health: AxisHealth, estimate: PreloadEstimate | None) -> tuple[Advice, ...]:
    """Tasks of an axis, the most urgent first; empty if there is nothing to do."""
    tasks = list(dict.fromkeys(_tasks(health, estimate)))
    crossings = () if health.trend is None else health.trend.crossings
    due = next((each for each in crossings if each.limit == "fault" and each.earliest_ns), None)
    greases = (Task.REGREASE,) if Task.REGREASE in tasks else ()
    return tuple(
        Advice(
            task=task,
            text=TEXTS[task],
            now=task is not Task.PLAN_NUT,
            due=due if task is Task.PLAN_NUT else None,
            together_with=greases if task in (Task.REPLACE_NUT, Task.PLAN_NUT) else (),
        )
        for task in tasks
    )


def _tasks(health: AxisHealth, estimate: PreloadEstimate | None) -> Iterator[Task]:
    active = {alarm.kind for alarm in health.alarms if alarm.active}
    doubt = AlarmKind.MODEL in active or _status(estimate) is EstimateStatus.INVALID
    if AlarmKind.SUDDEN_DROP in active:
        yield Task.INSPECT
    if doubt:
        yield Task.DIAGNOSE
    lost = health.condition is AxisCondition.FAULT or AlarmKind.PRELOAD_LOST in active
    low = health.condition is AxisCondition.WARNING or AlarmKind.PRELOAD_LOW in active
    if (lost or low) and (doubt or is_in_doubt(health)):
        yield Task.CONFIRM_LOSS
    elif lost:
        yield Task.REPLACE_NUT
    elif low or AlarmKind.RATE in active:
        yield Task.PLAN_NUT
    if AlarmKind.RATE in active:
        yield Task.FIND_WEAR
    if estimate and estimate.fault_probability.get("lubrication", 0.0) >= LIKELY_GREASE:
        yield Task.REGREASE
    said = () if estimate is None else estimate.reasons
    yield from (Task.TEST for reason in said if reason.startswith("test_due:"))
    if health.trend is not None and health.trend.status is TrendStatus.RISING:
        yield Task.FIND_CHANGE
    if AlarmKind.SERVICE in active:
        yield Task.CHECK_SERVICE
    if health.condition is AxisCondition.UNAVAILABLE:
        yield _for_a_number(health, estimate)
    elif AlarmKind.DATA_LOST in active:
        yield Task.WAIT
    if any(alarm.acknowledged_by is None for alarm in health.alarms):
        yield Task.ACKNOWLEDGE


def _for_a_number(health: AxisHealth, estimate: PreloadEstimate | None) -> Task:
    reasons = (*health.reasons, *(() if estimate is None else estimate.reasons))
    codes = [reason.partition(":")[0] for reason in reasons]
    if _status(estimate) is EstimateStatus.INSUFFICIENT_EXCITATION:
        codes.append("insufficient_excitation")
    tasks = (task for code, (_, task) in REASONS.items() if task and code in codes)
    return next(tasks, Task.WAIT)


def _status(estimate: PreloadEstimate | None) -> EstimateStatus | None:
    return None if estimate is None else estimate.status


def consistent(health: AxisHealth, estimate: PreloadEstimate | None) -> AxisHealth:
    """Return the health with alarms, trend, headline and advice that fit its condition and number.

    Limits that the axis has passed already have no date.
    """
    passed = _PASSED.get(health.condition, ())
    trend = health.trend
    if trend is not None:
        ahead = tuple(each for each in trend.crossings if each.limit not in passed)
        trend = trend.model_copy(update={"crossings": ahead})
    dated = (each for each in (trend.crossings if trend else ()) if each.earliest_ns is not None)
    now = {"trend": trend, "next_limit": next(dated, None), "alarms": as_of_now(health)}
    told = health.model_copy(update=now)
    return told.model_copy(update={"headline": headline(told), "advice": advice(told, estimate)})
